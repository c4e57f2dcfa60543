/* Called by @name@.c after each step, where its instructions are counted. */
void step_done(int step);

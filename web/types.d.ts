/** uPlot 1.6.32, which stands before the modules in a page. */
declare const uPlot: any;

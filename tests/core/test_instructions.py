"""Instructions of a function, and their order."""

import casadi as ca

from insenv.core.instructions import instructions, ordering


def test_a_chain_is_broken_up_and_a_rule_kept():
    x = ca.SX.sym("x", 2)
    first, second = x[0], x[1]
    for _ in range(20):
        first, second = first * first, ca.sqrt(second)
    steps = instructions(ca.Function("f", [x], [ca.vertcat(first, second)]))
    order = [k for k in ordering(steps, {}) if not steps[k].is_leaf]
    place = {k: i for i, k in enumerate(ordering(steps, {}))}
    assert all(place[source] < place[k] for k in place for source in steps[k].sources)
    names = [steps[k].name for k in order][:20]
    assert min(names.count("SQ"), names.count("SQRT")) > 2  # the two chains are interleaved
    outputs = [k for k, step in enumerate(steps) if step.name == "OUTPUT"]
    late = next(k for k, step in enumerate(steps) if step.name == "SQ")
    ruled = ordering(steps, {late: [outputs[1]]})
    assert ruled.index(late) > ruled.index(outputs[1])

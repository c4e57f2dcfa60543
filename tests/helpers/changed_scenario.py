"""A scenario with other keys."""

from insenv.scenario import load, parse


def changed(name, **sections):
    """A scenario with keys replaced: of sections, given as ``section={key: value}``, and of its own."""
    values = load(name).model_dump(mode="json", exclude_unset=True)
    for section, keys in sections.items():
        values[section] = {**(values.get(section) or {}), **keys} if isinstance(keys, dict) else keys
    return parse(values, name=name)

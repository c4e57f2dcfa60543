"""Messages about unknown names."""

from insenv.base.errors import nearest


def test_few_names_are_listed_and_of_many_the_nearest_with_where_all_are():
    assert nearest("super", ["perfect", "spp", "consumer"]) == " (allowed: perfect, spp, consumer)"
    assert nearest("roled", ["roll", "pitch"]) == "; did you mean 'roll'? (allowed: roll, pitch)"
    assert nearest("xxx", []) == " (allowed: none)"
    found = nearest("row_39x", [f"row_{k}" for k in range(40)], "`insenv list`")
    assert found.startswith("; did you mean 'row_39'? (allowed: row_") and ", row_39" in found
    assert found.endswith(" and 34 more; `insenv list` shows all)")
    assert len(found) < 160

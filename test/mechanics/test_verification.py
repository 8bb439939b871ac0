import pytest

from verification import load_cases

CASES = sorted(load_cases(), key=lambda one: one.name)  # one order in all processes, whichever imports what first


@pytest.mark.parametrize(
    "one", [pytest.param(one, id=one.name, marks=[pytest.mark.long] if one.long else []) for one in CASES]
)
def test_case(one):
    results = list(one.run())
    assert results
    for result in results:
        print(f"{one.name}: {result}")
    assert [result for result in results if not result.passed] == []

import pytest

from verification import load_cases


@pytest.mark.parametrize(
    "one", [pytest.param(one, id=one.name, marks=[pytest.mark.long] if one.long else []) for one in load_cases()]
)
def test_case(one):
    results = list(one.run())
    assert results
    for result in results:
        print(f"{one.name}: {result}")
    assert [result for result in results if not result.passed] == []

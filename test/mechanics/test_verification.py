import pytest

from verification import load_cases


@pytest.mark.parametrize("one", load_cases(), ids=lambda one: one.name)
def test_case(one):
    results = list(one.run())
    assert results
    for result in results:
        print(f"{one.name}: {result}")
    assert [result for result in results if not result.passed] == []

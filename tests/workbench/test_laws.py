"""A law that is no Python is refused in a sentence, whatever it is."""

import pytest

from rfea_vision.errors import InputError
from rfea_vision.workbench.laws import check


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("def law(:\n", "line 1: "),
        ("x = 1\0", "null"),
        ("x = " + "(" * 5000 + ")" * 5000, "paren"),
        ("x = " + "-" * 100_000 + "1", "nested too deep"),
    ],
    ids=["a slip", "a null character", "brackets", "signs"],
)
def test_a_law_that_is_no_python_is_refused_in_a_sentence(tmp_path, text, says):
    file = tmp_path / "law.py"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        check(file)
    assert says in str(refused.value) and "None" not in str(refused.value)

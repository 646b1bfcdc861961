"""One key is set; comments, order and form of everything else stay as people left them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rfea_vision.campaign.template import write_campaign_template
from rfea_vision.errors import InputError
from rfea_vision.workbench.clocks import write_sync
from rfea_vision.workbench.pointing import write_hint
from rfea_vision.workbench.yaml_edit import set_keys, take_out, with_key, without_key

WRITTEN = """# our tube, see lab book p. 12
format: rfea-campaign/1
name: "tube A"   # silicone
camera:
  board: {kind: checkerboard, inner_corners: [9, 6], square: 12 mm}  # bought
  photos:
    - a.jpg
    - b.jpg
  # the clamp is found well enough

sync: motion # try led
"""
CLAMP = [[10.5, 20], [30, 20]]
SCALE = {"points": [[10, 20], [10, 220]], "distance": "155 mm"}


@pytest.mark.parametrize(
    ("keys", "value", "there"),
    [
        (
            ("camera", "clamp"),
            CLAMP,
            "  photos:\n    - a.jpg\n    - b.jpg\n  clamp: [[10.5, 20], [30, 20]]\n  # the clamp",
        ),
        (("camera", "board", "marker"), "8 mm", "square: 12 mm, marker: 8 mm}  # bought"),
        (("camera", "board", "square"), "10 mm", "square: 10 mm}  # bought"),
        (("camera", "photos"), "c.jpg", "  photos: c.jpg\n  # the clamp"),
        (("name",), "tube B", "name: tube B   # silicone"),
        (("sync",), {"method": "offset", "value": "12.5 ms"}, "sync: {method: offset, value: 12.5 ms} # try led"),
        (("rig", "gravity"), "up", "sync: motion # try led\nrig:\n  gravity: up\n"),
    ],
)
def test_only_the_key_changes(keys, value, there):
    changed = with_key(WRITTEN, keys, value)
    assert there in changed
    for comment in (
        "# our tube, see lab book p. 12",
        "# silicone",
        "# bought",
        "# the clamp is found well enough",
        "# try led",
    ):
        assert comment in changed


def test_a_value_set_twice_stands_once():
    once = with_key(WRITTEN, ("camera", "clamp"), CLAMP)
    assert with_key(once, ("camera", "clamp"), CLAMP) == once
    assert with_key(once, ("camera", "clamp"), None).count("clamp:") == 1


def test_windows_line_ends_stay(tmp_path):
    file = tmp_path / "campaign.yaml"
    file.write_bytes(WRITTEN.replace("\n", "\r\n").encode())
    set_keys(file, {("camera", "tip"): [1, 2]})
    assert file.read_bytes().count(b"\r\n") == file.read_bytes().count(b"\n") == WRITTEN.count("\n") + 1


@pytest.mark.parametrize("text", ["a: &x {b: 1}\ncamera: *x\n", "camera: [1, 2]\n- b\n"])
def test_what_cannot_be_changed_alone_is_left(tmp_path, text):
    file = tmp_path / "campaign.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match="by hand"):
        set_keys(file, {("camera", "clamp"): CLAMP})
    assert file.read_text() == text


def test_a_list_that_is_not_indented_gives_way_to_keys():
    assert (
        with_key("camera:\n- 1\nsync: motion\n", ("camera", "clamp"), [1, 2])
        == "camera: {clamp: [1, 2]}\nsync: motion\n"
    )


names = st.text("abcxyz_", min_size=1, max_size=4)
leaves = st.one_of(
    st.integers(-9, 9), st.text("ab :#'\"é", max_size=6), st.none(), st.lists(st.integers(0, 9), max_size=3)
)
trees = st.dictionaries(names, st.one_of(leaves, st.dictionaries(names, leaves, max_size=3)), min_size=1, max_size=4)


@given(trees, names, names, leaves, st.sampled_from([True, False, None]))
def test_any_key_of_any_file(tree, first, second, value, style):
    text = yaml.safe_dump(tree, default_flow_style=style, allow_unicode=True)
    changed = yaml.safe_load(with_key(text, (first, second), value))
    inner = tree.get(first) if isinstance(tree.get(first), dict) else {}
    assert changed == {**tree, first: {**inner, second: value}}


@given(trees, names, names, leaves, st.sampled_from([True, False, None]))
def test_any_key_of_any_file_goes_as_it_came(tree, first, second, value, style):
    inner = tree.get(first) if isinstance(tree.get(first), dict) else {}
    text = yaml.safe_dump({**tree, first: {**inner, second: value}}, default_flow_style=style, allow_unicode=True)
    left = yaml.safe_load(without_key(text, (first, second)))
    inner = {key: item for key, item in inner.items() if key != second}
    assert (left[first] or {}) == inner and {**left, first: 0} == {**tree, first: 0}


def test_a_key_is_taken_out_with_its_own_comment_and_no_other(tmp_path):
    file = tmp_path / "campaign.yaml"
    file.write_text(WRITTEN.replace("  # the clamp", "  tip: [1, 2]  # the end\n  # the clamp"))
    take_out(file, ("camera", "tip"))
    assert file.read_text() == WRITTEN
    file.write_text("camera:\n  # a phone\n  scale:\n    points: [[1, 2], [3, 4]]\n    distance: 9 cm  # a ruler\nsync: motion\n")
    take_out(file, ("camera", "scale"))
    assert file.read_text() == "camera:\n  # a phone\nsync: motion\n"
    for text in ("a: &x {tip: 1}\ncamera: *x\n", "camera: {clamp: 1}\n", "camera: [1, 2]\n"):
        file.write_text(text)
        with pytest.raises(InputError, match="take the key out by hand"):
            take_out(file, ("camera", "tip"))
        assert file.read_text() == text


def test_an_offset_of_minutes_is_kept_to_the_microsecond(tmp_path):
    file = tmp_path / "experiment.yaml"
    file.write_text("role: train\n")
    experiment: Any = SimpleNamespace(file=file)
    write_sync(experiment, {"method": "offset", "value_ms": 123456.78})
    assert yaml.safe_load(file.read_text())["sync"] == {"method": "offset", "value": "123456.780 ms"}


def test_a_lone_experiment_holds_what_is_pointed_at_for_all_films(tmp_path):
    file = tmp_path / "experiment.yaml"
    file.write_text("camera: {hints: {}}\n")
    campaign: Any = SimpleNamespace(root=tmp_path)
    experiment: Any = SimpleNamespace(file=file)
    assert write_hint(campaign, experiment, "tip", None, everywhere=True) == file
    assert yaml.safe_load(file.read_text())["camera"]["tip"] is None


BARE = """camera:
  # board: {kind: checkerboard}  # needed: a board, with 'photos' of it; or 'scale'
  # scale: {points: [[x, y], [x, y]], distance: 155 mm}  # needed: two points of the first frame
sync: motion
"""


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_key_goes_below_a_heading_in_place_of_its_example(end):
    changed = with_key(BARE.replace("\n", end), ("camera", "scale"), SCALE)
    lines = BARE.splitlines()
    lines[2] = "  scale: {points: [[10, 20], [10, 220]], distance: 155 mm}"
    assert changed.split(end) == [*lines, ""]
    beside = with_key(BARE, ("camera", "clamp"), CLAMP)
    assert beside.splitlines() == [*BARE.splitlines()[:3], "  clamp: [[10.5, 20], [30, 20]]", "sync: motion"]
    assert "# scale" not in with_key(beside, ("camera", "scale"), SCALE)
    assert with_key("camera:  # a phone", ("camera", "tip"), [1, 2]) == "camera:  # a phone\n  tip: [1, 2]\n"


@pytest.mark.parametrize(("keys", "value"), [(("camera", "clamp"), CLAMP), (("camera", "tip"), [5, 6]), (("rig", "gravity"), "none")])
def test_a_key_goes_where_init_left_the_line_that_most_films_need(tmp_path, keys, value):
    write_campaign_template(tmp_path / "c")
    before = (tmp_path / "c" / "campaign.yaml").read_text()
    changed = with_key(before, keys, value).splitlines()
    example = keys[-1] if keys[0] == "camera" else "rig"
    lines = before.splitlines()
    at = next(row for row, line in enumerate(lines) if line.lstrip().startswith(f"# {example}: "))
    assert lines[:at] == changed[:at] and lines[at + 1 :] == changed[len(changed) - len(lines) + at + 1 :]
    assert changed[at].lstrip().startswith(f"{example}:")

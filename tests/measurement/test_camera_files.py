"""Camera files that are not right: one sentence that names file, key and remedy."""

from types import SimpleNamespace

import av
import numpy as np
import pytest
from campaign.campaigns import write_campaign

from rfea_vision.calibration.photos import unlike_film
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.calibration.storage import load_calibration, save_calibration, save_ros
from rfea_vision.campaign import VideoSpec
from rfea_vision.campaign.check import check_campaign
from rfea_vision.campaign.plausibility import of_rate
from rfea_vision.errors import InputError
from rfea_vision.stages import open_campaign
from rfea_vision.stages.cameras import own_times


@pytest.mark.parametrize("photos", [False, True])
@pytest.mark.parametrize(
    ("film", "says"),
    [
        ((720, 1280), None),
        ((360, 640), None),  # the same picture, smaller
        ((720, 1278), None),  # an encoder that wants multiples of four
        ((1280, 720), "one of them is turned"),
        ((640, 480), "the video's camera mode"),
    ],
)
def test_a_film_of_another_shape_is_told_from_a_turned_one(film, says, photos):
    told = unlike_film((720, 1280), film, photos=photos)
    assert told == "" if says is None else says in told and f"{film[0]} x {film[1]}" in told
    assert says is None or ("camera.photos have" in told) == photos


def test_a_film_unlike_its_earlier_calibration_is_not_told_of_photos_that_are_not_there(tmp_path):
    """`check` said nothing, and `track` that camera.photos had another size, of which the campaign had none."""
    write_campaign(tmp_path, {"steps": "train"})
    save_calibration(tmp_path / "camera.yaml", scaled_by_distance((720, 1280), [[0, 0], [100, 0]], 50.0))
    with av.open(str(tmp_path / "steps" / "film.mp4"), "w") as made:
        stream = made.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(8):
            made.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((48, 64), np.uint8), format="gray")))
        made.mux(stream.encode(None))
    with (tmp_path / "campaign.yaml").open("a") as file:
        file.write("camera: {file: camera.yaml}\n")
    run = tmp_path / "steps" / "experiment.yaml"
    run.write_text(run.read_text().replace("track: {file: track.csv}", "video: {file: film.mp4}"))
    said = [str(problem) for problem in check_campaign(tmp_path).problems if problem.severity == "error"]
    assert len(said) == 1 and said[0].startswith(f"{run}:4: video: the video has 64 x 48 px, its camera was calibrated for 720 x 1280;")
    with pytest.raises(InputError, match=r"its camera was calibrated for 720 x 1280; calibrate in .* or point at camera\.scale"):
        open_campaign(tmp_path).track(["steps"])


@pytest.mark.parametrize(("given", "own", "doubted"), [(None, 30.0, False), (240.0, 30.0, False), (30.0, 29.97, False),
                                                       (120.0, 240.0, True), (250.0, 240.0, True), (25.0, None, False)])  # fmt: skip
def test_a_rate_that_no_slow_motion_has_is_doubted(given, own, doubted):
    said = of_rate(given, own)
    assert bool(said) == doubted and all(f"{given:g} Hz replaces the {own:g} frames/s" in text for text in said)


def test_the_times_that_a_film_tells_of_itself_begin_where_the_run_does(tmp_path):
    """Beside a rate that was given, which counts pictures."""
    with av.open(str(tmp_path / "film.mp4"), "w") as made:
        stream = made.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        for _ in range(8):
            made.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((64, 64), np.uint8), format="gray")))
        made.mux(stream.encode(None))
    run = SimpleNamespace(video=VideoSpec(file=tmp_path / "film.mp4", rate_Hz=200.0), track=None)
    given = 3.0 + np.arange(8) / 200
    np.testing.assert_allclose(own_times(run, given), 3.0 + np.arange(8) / 25)
    assert own_times(run, given[:5]) is None  # not the pictures of this film
    assert own_times(SimpleNamespace(video=VideoSpec(file=tmp_path / "film.mp4"), track=None), given) is None


GOOD = """image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [533, 0, 342, 0, 533, 234, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.05, 0, 0, 0]}
"""
BROKEN = {
    "empty": ("", "not an OpenCV or ROS camera file"),
    "a list": ("- 1\n- 2\n", "not an OpenCV or ROS camera file"),
    "prose": ("hello there", "not an OpenCV or ROS camera file"),
    "three numbers": (GOOD.replace("342, 0, 533, 234, 0, 0, 1", "342"), "camera_matrix must be nine numbers"),
    "not numbers": (GOOD.replace("533, 0, 342", "wide, 0, 342"), "camera_matrix must be nine numbers"),
    "nan": (GOOD.replace("533, 0, 342", ".nan, 0, 342"), "with positive fx and fy"),
    "mirrored": (GOOD.replace("533, 0, 342", "-533, 0, 342"), "with positive fx and fy"),
    "columns first": (GOOD.replace("533, 0, 342, 0, 533, 234, 0, 0, 1", "533, 0, 0, 0, 533, 0, 342, 234, 1"), "row by row"),
    "another size": (GOOD.replace("width: 640", "width: 320"), r"its middle \(342, 234\) lies outside of the picture"),
    "size in words": (GOOD.replace("width: 640", "width: big"), "image_width is 'big'"),
    "no size": (GOOD.replace("image_height: 480\n", ""), "image_height is missing"),
    "no distortion": (GOOD.split("distortion_model")[0], "write five zeros for a lens without distortion"),
    "unknown lens": (GOOD.replace("plumb_bob", "mystery"), "distortion_model 'mystery' is not supported"),
    "many coefficients": (GOOD.replace("0, 0, 0]}", "0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.1]}"), "at most"),
    "coefficients in words": (GOOD.replace("-0.28", "much"), "must be a list of numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_camera_file_says_what_to_do(name, tmp_path):
    text, said = BROKEN[name]
    file = tmp_path / "camera.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=said) as error:
        load_calibration(file)
    assert str(error.value).startswith(f"{file}: ") and "\n" not in str(error.value)


def test_the_same_file_unbroken_is_read(tmp_path):
    file = tmp_path / "camera.yaml"
    file.write_text(GOOD)
    assert load_calibration(file).distortion.tolist() == [-0.28, 0.05, 0, 0, 0]


def test_a_file_with_thin_prism_coefficients_is_read_and_written_back(tmp_path):
    file, ros = tmp_path / "camera.yaml", tmp_path / "ros.yaml"
    coefficients = [-0.28, 0.05, 0, 0, 0, 0, 0, 0, 1e-3, 0, -2e-3, 0]
    file.write_text(GOOD.replace("[-0.28, 0.05, 0, 0, 0]", str(coefficients)))
    found = load_calibration(file)
    save_ros(ros, found)
    assert found.model == load_calibration(ros).model == "brown12"
    assert found.distortion.tolist() == load_calibration(ros).distortion.tolist() == coefficients

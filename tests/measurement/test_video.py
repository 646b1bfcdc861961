"""Time stamps, not frame numbers."""

import re
import struct
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.campaign.plausibility import of_damage, of_end
from rfea_vision.errors import InputError
from rfea_vision.readers import apart
from rfea_vision.readers.video import FolderSource, open_frames, open_video
from rfea_vision.vision import make_clip, preview_video, track_frames
from testing.scenes import Look, bending, film
from testing.sources import memory_source, true_calibration


def write(path, pictures, stamps_ms, rate=1000):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.height, stream.width = pictures[0].shape
        stream.pix_fmt = "yuv420p"
        stream.time_base = Fraction(1, 1000)
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.options = {"crf": "18", "preset": "veryfast", "threads": "1"}
        for picture, stamp in zip(pictures, stamps_ms, strict=True):
            frame = av.VideoFrame.from_ndarray(picture, format="gray").reformat(format="yuv420p")
            frame.pts, frame.time_base = int(stamp), Fraction(1, 1000)
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)


def numbered(count, size=(64, 48)):
    return [np.full(size, 20 + 2 * k, np.uint8) for k in range(count)]


def test_a_variable_rate_keeps_its_times(tmp_path):
    stamps = np.cumsum([0, 4, 4, 9, 4, 4, 30, 4, 4, 5])
    path = tmp_path / "v.mp4"
    write(path, numbered(10), stamps)
    source = open_video(path)
    frames = [(t, luma.mean()) for t, luma in source]
    assert source.size == (48, 64)
    np.testing.assert_allclose([t for t, _ in frames], stamps / 1000, atol=1e-3)
    np.testing.assert_allclose(source.times_s(), stamps / 1000, atol=1e-3)
    assert np.all(np.diff([level for _, level in frames]) > 0)


def test_the_rate_of_a_slow_motion_file_can_be_given(tmp_path):
    path = tmp_path / "v.mp4"
    write(path, numbered(8), np.arange(8) * 33)
    times = [t for t, _ in open_video(path, 240.0)]
    np.testing.assert_allclose(times, np.arange(8) / 240)


@pytest.mark.parametrize("elsewhere", [False, True])
@pytest.mark.parametrize("rate_Hz", [None, 500.0])
def test_damage_inside_a_film_is_told_and_costs_no_picture_after_it(tmp_path, rate_Hz, elsewhere):
    path = tmp_path / "v.mp4"
    noise = np.random.default_rng(0).integers(0, 256, (40, 64, 48), dtype=np.uint8)
    write(path, list(noise), np.arange(40) * 4)
    with av.open(str(path)) as container:
        at, size = [(packet.pos, packet.size) for packet in container.demux(video=0)][20]
    data = bytearray(path.read_bytes())
    data[at : at + size] = bytes(size)
    path.write_bytes(data)
    with apart.isolating(elsewhere):
        source = open_video(path, rate_Hz)
        times = [time for time, _ in source]
        (places,) = source.damaged_s()
    step = 0.004 if rate_Hz is None else 0.002
    assert len(times) >= 35 and times[-1] == pytest.approx(39 * step, abs=1e-6)  # dated as if nothing had been lost
    assert places == pytest.approx([19 * step, 39 * step], abs=2 * step)
    assert re.search("damaged from 0.0[78] to 0.1[56] s, where", of_damage(np.array([[19 * 0.004, 39 * 0.004]]))[0])


def test_reading_can_start_inside(tmp_path):
    path = tmp_path / "v.mp4"
    write(path, numbered(100, (32, 32)), np.arange(100) * 4)
    source = open_video(path)
    every = [(t, float(luma.mean())) for t, luma in source]
    later = [(t, float(luma.mean())) for t, luma in source.frames(70)]
    assert later == every[70:]


def test_a_folder_of_pictures(tmp_path):
    for k, picture in enumerate(numbered(4)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture)
    table = tmp_path / "frames.csv"
    table.write_text("file,time_s\n" + "".join(f"{k}.png,{0.01 * k}\n" for k in range(4)))
    frames = list(open_frames(tmp_path, table))
    assert [t for t, _ in frames] == [0.0, 0.01, 0.02, 0.03]
    assert frames[3][1][0, 0] == 26
    table.write_text("file,time_s\n0.png,0.5\n1.png,0.1\n")
    with pytest.raises(InputError, match="backwards"):
        open_frames(tmp_path, table)
    table.write_text("file,time_s\nnone.png,0.5\n")
    with pytest.raises(InputError, match=r"none\.png"):
        open_frames(tmp_path, table)


def _never(*_):
    raise AssertionError("decoded in this process")


@pytest.mark.parametrize("elsewhere", [False, True])
@pytest.mark.parametrize(("white", "bits"), [(4095, 12), (1000, 10), (60000, 16), (255, 8)])
def test_pictures_of_a_camera_of_12_bits_are_not_black(tmp_path, white, bits, elsewhere, monkeypatch):
    """It writes them into 16 bits, of which white then is a sixteenth; the first picture may be darker than the others."""
    for number, share in enumerate((0.02, 0.5, 1.0)):
        grey = np.full((40, 60), round(share * white), np.uint16)
        cv2.imwrite(str(tmp_path / f"{number}.tif"), grey)
    told = [round(share * white) >> (bits - 8) for share in (0.02, 0.5, 1.0)]
    if elsewhere:
        for decoder in ("imdecode", "imcount"):
            monkeypatch.setattr(cv2, decoder, _never)
    with apart.isolating(elsewhere):
        source = open_frames(tmp_path, None, 10.0)
        assert [int(luma[0, 0]) for _, luma in source.frames()] == pytest.approx(told, abs=1)
        assert [int(picture[0, 0, 1]) for _, picture in source.colours()] == pytest.approx(told, abs=1)


def _packed_tiff(grey: np.ndarray, bits: int) -> bytes:
    """Grey levels (h, w) as high-speed cameras write them: each pixel takes as many bits as it has, one behind the other."""
    rows = [(int(level) >> bit) & 1 for level in grey.ravel() for bit in reversed(range(bits))]
    data = np.packbits(np.array(rows, np.uint8)).tobytes()
    height, width = grey.shape
    tags = [(256, width), (257, height), (258, bits), (259, 1), (262, 1), (273, 8 + 2 + 12 * 9 + 4)]
    tags += [(277, 1), (278, height), (279, len(data))]
    listed = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    return struct.pack("<2sHI", b"II", 42, 8) + struct.pack("<H", len(tags)) + listed + struct.pack("<I", 0) + data


@pytest.mark.parametrize("elsewhere", [False, True])
@pytest.mark.parametrize("bits", [10, 12, 14])
def test_pictures_whose_pixels_are_packed_are_read(tmp_path, bits, elsewhere):
    """They were called unreadable, and were to be copied again."""
    white = (1 << bits) - 1
    for number, share in enumerate((0.02, 0.5, 1.0)):
        grey = np.full((40, 60), round(share * white), np.uint16)
        (tmp_path / f"{number}.tif").write_bytes(_packed_tiff(grey, bits))
    told = [round(share * white) >> (bits - 8) for share in (0.02, 0.5, 1.0)]
    with apart.isolating(elsewhere):
        source = open_frames(tmp_path, None, 10.0)
        assert [int(luma[0, 0]) for _, luma in source.frames()] == pytest.approx(told, abs=1)
        assert [int(picture[0, 0, 1]) for _, picture in source.colours()] == pytest.approx(told, abs=1)


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_stack_of_pictures_in_one_file_is_no_folder_of_pictures(tmp_path, elsewhere):
    cv2.imwritemulti(str(tmp_path / "stack.tif"), numbered(4))
    with (
        apart.isolating(elsewhere),
        pytest.raises(InputError, match=r"stack\.tif: holds 4 pictures, and of each file one is read; save the stack"),
    ):
        open_frames(tmp_path, None, 10.0)


@pytest.mark.parametrize("text", ["file;time_s\n9.png;0\n10.png;0,5\n", "file, time_s\n9.png, 0\n10.png, 0.5\n"])
def test_pictures_are_listed_in_any_table_or_in_none(tmp_path, text):
    for number, picture in zip((9, 10), numbered(2), strict=True):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture)
    (tmp_path / "frames.csv").write_text(text)
    listed = open_frames(tmp_path, tmp_path / "frames.csv")
    assert listed.times_s().tolist() == [0.0, 0.5]
    plain = open_frames(tmp_path, None, 2.0)
    assert isinstance(plain, FolderSource) and isinstance(listed, FolderSource)
    assert (plain.files, plain.times) == (listed.files, listed.times)
    with pytest.raises(InputError, match=r"frames.folder: says no times.*'rate: 240 Hz'"):
        open_frames(tmp_path, None)


@pytest.mark.parametrize("matrix", ["bt2020c", "bt709"])
def test_a_film_is_read_in_colour_whatever_matrix_it_names(tmp_path, matrix):
    """FFmpeg turns none of constant luminance into another; a phone's film had ended in its words."""
    path = tmp_path / "hdr.mp4"
    blue = np.full((48, 64, 3), (200, 60, 40), np.uint8)
    with av.open(path, "w") as container:
        stream = container.add_stream("libx264", 30, options={"x264-params": f"colormatrix={matrix}"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        container.mux([*stream.encode(av.VideoFrame.from_ndarray(blue, format="bgr24")), *stream.encode()])
    ((_, seen),) = open_video(path).colours()
    assert np.abs(seen.mean(axis=(0, 1)) - (200, 60, 40)).max() < 25


def test_broken_files_are_named(tmp_path):
    with pytest.raises(InputError, match="not found"):
        open_video(tmp_path / "none.mp4")
    junk = tmp_path / "junk.mp4"
    junk.write_bytes(b"no video" * 100)
    with pytest.raises(InputError, match="not a readable video"):
        open_video(junk)


def test_clip_and_preview_of_a_compressed_film(tmp_path, small_lens):
    pictures, times, shapes = film(small_lens, Look(), bending(np.arange(48) / 240))
    path = tmp_path / "v.mp4"
    write(path, pictures, np.round(1000 * times))
    calibration = true_calibration(small_lens)
    source = open_video(path)
    track = track_frames(source, calibration, Actuator())
    assert track.valid.all()
    tip = track.dataset["tip"].values - np.array([s.tip for s in shapes])
    assert np.sqrt(np.mean(np.sum(tip**2, axis=1))) < 0.15  # half the usual pixels, 20 px from frame to frame
    facts = make_clip(source, track, calibration, tmp_path / "clip.mp4")
    with av.open(str(tmp_path / "clip.mp4")) as container:
        shown = [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]
    assert len(shown) == len(facts["times_s"]) == len(pictures), "a fast film that is over at once is shown whole"
    assert shown[0].shape == (facts["height"], facts["width"])
    # Rig mm land where the facts say: on the centre line it is light, 8 mm beside it dark.
    number = int(np.argmin(np.abs(track.time_s - facts["times_s"][-1])))
    for node in (8, 16, 24):
        x, y = track.dataset["midline"].values[number, node]
        column, row = (x - facts["x_min_mm"]) * facts["px_per_mm"], (facts["y_max_mm"] - y) * facts["px_per_mm"]
        assert shown[-1][int(row), int(column)] > 150
        assert shown[-1][int(row), int(column + 8 * facts["px_per_mm"])] < 100
    assert preview_video(source, track, calibration, tmp_path / "whole.mp4") == pytest.approx(8, rel=0.05), "240 a second at 30"
    preview_video(source, track, calibration, tmp_path / "preview.mp4", every=12)
    with av.open(str(tmp_path / "preview.mp4")) as container:
        assert sum(1 for _ in container.decode(video=0)) == 4
        assert float(container.streams.video[0].average_rate or 0) == pytest.approx(20, rel=0.05), "every twelfth of 240 a second"


def test_a_preview_shows_the_colours_of_the_film(tmp_path, small_lens, monkeypatch):
    """By them marks are pointed at, and `camera.colour`; and it had always played at 30 frames a second."""
    pictures, times, _ = film(small_lens, Look(), bending(np.arange(6) / 12), rate_Hz=12)
    source = memory_source(pictures, times)
    track = track_frames(source, true_calibration(small_lens), Actuator())
    reddish = [(time, np.dstack([grey // 4, grey // 4, grey])) for time, grey in source.frames()]
    monkeypatch.setattr(type(source), "colours", lambda *_: iter(reddish))
    preview_video(source, track, true_calibration(small_lens), tmp_path / "preview.mp4")
    with av.open(str(tmp_path / "preview.mp4")) as container:
        shown = [frame.to_ndarray(format="rgb24").reshape(-1, 3).mean(axis=0) for frame in container.decode(video=0)]
        assert float(container.streams.video[0].average_rate or 0) == pytest.approx(12)
    assert len(shown) == 6 and all(red > 2 * blue for red, _, blue in shown)


def test_memory_source_times_are_kept(small_lens):
    pictures, _, _ = film(small_lens, Look(), [0.0, 0.0])
    track = track_frames(memory_source(pictures, [0.5, 0.75]), true_calibration(small_lens), Actuator())
    np.testing.assert_array_equal(track.time_s, [0.5, 0.75])


def turn_on_display(path, clockwise: int) -> None:
    """Write into an MP4's track header by how many quarter turns a player turns the pictures, as phones do."""
    matrix = {1: (0, 1, -1, 0), 2: (-1, 0, 0, -1), 3: (0, -1, 1, 0)}[clockwise]
    content = bytearray(path.read_bytes())
    at = content.index(b"tkhd") + 4 + 40  # ISO 14496-12: the matrix follows 40 bytes of a header of version 0
    assert content[at - 40] == 0
    for place, value in zip((0, 4, 12, 16), matrix, strict=True):
        content[at + place : at + place + 4] = int(value * 65536).to_bytes(4, "big", signed=True)
    path.write_bytes(content)


@pytest.mark.parametrize("clockwise", [1, 3])
def test_a_phone_held_upright_is_tracked_as_it_is_shown(tmp_path, small_lens, clockwise):
    pictures, times, shapes = film(small_lens, Look(), bending(np.arange(12) / 60), rate_Hz=60)
    path = tmp_path / "v.mp4"
    write(path, [np.rot90(picture, clockwise).copy() for picture in pictures], np.round(1000 * times))
    turn_on_display(path, clockwise)
    source = open_video(path)
    assert source.size == small_lens.size
    shown = source.frame(0).ravel()
    alike = np.corrcoef(shown, pictures[0].ravel())[0, 1]
    assert alike > 0.9 > np.corrcoef(shown, pictures[0][::-1, ::-1].ravel())[0, 1] + 0.3
    track = track_frames(source, true_calibration(small_lens), Actuator())
    assert track.valid.all()
    tip = track.dataset["tip"].values - np.array([s.tip for s in shapes])
    assert np.sqrt(np.mean(np.sum(tip**2, axis=1))) < 0.15


@pytest.mark.parametrize("ending", ["mkv", "avi"])
def test_a_film_that_lost_its_tail_is_told_by_the_length_that_it_announces(tmp_path, ending):
    whole = tmp_path / f"whole.{ending}"
    noise = np.random.default_rng(1)
    with av.open(str(whole), "w") as container:
        stream = container.add_stream("mpeg4", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(90):
            picture = noise.integers(0, 255, (48, 64, 3), dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        container.mux(stream.encode())
    cut = tmp_path / f"cut.{ending}"
    content = whole.read_bytes()
    cut.write_bytes(content[: len(content) * 7 // 10])
    for path, doubts in ((whole, 0), (cut, 1)):
        source = open_video(path)
        said = of_end(float(source.times_s()[-1]), source.announced_s, listed=True)
        assert len(said) == doubts, (path, said)
    assert said[0].startswith("the last picture that is in the file is at ") and "the file announces 3.00 s; was it cut off" in said[0]
    assert open_video(cut, 240.0).announced_s is None  # its own time is not that of filming

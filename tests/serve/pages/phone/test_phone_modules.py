"""The modules of the phone page in node, on vectors that the line computes."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from elfslam.base.values import Audio
from elfslam.data.baseband import Baseband, in_band, read_baseband, to_baseband
from elfslam.data.recordings import read_recording
from elfslam.stages.chirp import ChirpParameters, describe_chirp, make_chirp
from elfslam.stages.echo import EchoParameters, find_arrivals, matched_envelope, to_echo_rate
from elfslam.world.interference import speech_like
from studies.eavesdropping import FORMS
from studies.speech import down, intelligibility
from tests.in_node import needs_node, passed_in_node, run_node
from tests.serve.pages.phone.conftest import room_sound

HERE = Path(__file__).parent
PAGES = HERE.parents[3] / "src" / "elfslam" / "serve" / "pages"
RATES_HZ = (44_100, 48_000)
SOUND_S = 1.45
BASEBAND_HZ, CENTRE_HZ, FRAME_SAMPLES = 6300, 17_500.0, 504
HALF_SUPPORT_S, KAISER_SHAPE, CUTOFF_HZ = 0.007, 14.0, 3150.0


def envelope_at(sound: np.ndarray, rate_hz: int) -> np.ndarray:
    """elfslam's matched filter, at any rate: that of the line knows its own rate only."""
    chirp = make_chirp(ChirpParameters(), rate_hz)
    if rate_hz == RATES_HZ[0]:
        return matched_envelope(sound, chirp)
    template = chirp.samples.astype(np.float64)
    kernel = np.conj(signal.hilbert(template)[::-1]) / np.sum(template**2)
    return np.abs(signal.oaconvolve(sound, kernel)[len(kernel) - 1 :])


def baseband_by_definition(sound: np.ndarray, rate_hz: int, first: int) -> np.ndarray:
    """One frame, I and Q by turns, sample by sample as data/baseband.py writes the sum."""
    n = np.arange(len(sound))
    grid_hz = np.lcm(rate_hz, BASEBAND_HZ)
    support_s = round(HALF_SUPPORT_S * grid_hz) / grid_hz
    turned = sound * np.exp(-2j * np.pi * CENTRE_HZ * n / rate_hz)
    frame = []
    for k in range(first, first + FRAME_SAMPLES):
        t_s = k / BASEBAND_HZ - n / rate_hz
        near = abs(t_s) <= support_s
        x = np.minimum(abs(t_s[near]) / support_s, 1)
        window = np.i0(KAISER_SHAPE * np.sqrt(1 - x**2)) / np.i0(KAISER_SHAPE)
        taps = 2 * CUTOFF_HZ / rate_hz * np.sinc(2 * CUTOFF_HZ * t_s[near]) * window
        frame.append(2 * np.sum(taps * turned[near]))
    return np.stack([np.real(frame), np.imag(frame)], axis=1).ravel()


def vectors_at(sound: np.ndarray, rate_hz: int) -> dict[str, object]:
    chirp = make_chirp(ChirpParameters(), rate_hz)
    echo_rate_sound = to_echo_rate(Audio(sound[None], rate_hz))
    envelope = matched_envelope(echo_rate_sound, chirp)
    found = find_arrivals(envelope, RATES_HZ[0] // 10, EchoParameters())
    first = round(0.138 * BASEBAND_HZ)
    return {
        "sound": sound.tolist(),
        "chirp": chirp.samples.tolist(),
        "envelope": envelope_at(sound, rate_hz)[:6000].tolist(),
        "arrivals_s": (found.samples / RATES_HZ[0]).tolist(),
        "baseband": {"first": first, "iq": baseband_by_definition(sound, rate_hz, first).tolist()},
        "in_band": in_band(Audio(sound[None], rate_hz)).samples[0, :6000].tolist(),
    }


@pytest.fixture(scope="session")
def vectors(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What Python computes, for the modules of the page to compare with."""
    file = tmp_path_factory.mktemp("vectors") / "vectors.json"
    given = {str(hz): vectors_at(room_sound(hz, SOUND_S), hz) for hz in RATES_HZ}
    file.write_text(json.dumps({"chirp": describe_chirp(), **given}))
    return file


@needs_node
@pytest.mark.parametrize("file", sorted(HERE.glob("*.test.mjs")), ids=lambda file: file.stem)
def test_the_modules_of_the_page(file: Path, vectors: Path) -> None:
    passed_in_node(file, ELFSLAM_VECTORS=vectors)


CUT = """
import { readFileSync, writeFileSync } from "node:fs";
const { FRAME_HEADERS, makeFramer, wavHeader } = await import(process.argv[1] + "/phone/framer.js");
const { excitationOf, CHIRP } = await import(process.argv[1] + "/stages/chirp.js");
const [, , soundFile, folder, rate, kind] = process.argv;
const rateHz = Number(rate);
const bytes = readFileSync(soundFile);
const sound = new Float32Array(bytes.buffer, bytes.byteOffset, bytes.length / 4);
const framer = makeFramer({
  rateHz, chirp: excitationOf(CHIRP, rateHz), period: rateHz / 10, kind,
});
const { frames } = framer.push(0, sound);
const names = { whole: ["frames.csv", "frames.wav"], baseband: ["baseband.csv", "baseband.iq"] };
const [table, file] = names[kind];
const head = kind === "whole" ? [wavHeader(rateHz)] : [];
writeFileSync(`${folder}/${file}`, Buffer.concat([...head, ...frames.map((frame) => frame.bytes)]));
const header = FRAME_HEADERS[kind];
writeFileSync(`${folder}/${table}`, header + frames.map((frame) => frame.row).join(""));
"""


def cut_in_node(folder: Path, sound: np.ndarray, rate_hz: int, kind: str) -> None:
    """What the page would keep of the sound, as files of a recording."""
    sound_file = folder / "sound.f32"
    sound_file.write_bytes(sound.tobytes())
    script = ["--input-type=module", "--eval", CUT]
    done = run_node(*script, PAGES.as_uri(), sound_file, folder, rate_hz, kind)
    assert done.returncode == 0, done.stderr


def manifest_of(rate_hz: int, kind: str) -> dict[str, object]:
    manifest: dict[str, object] = {
        "format_version": 1,
        "chirp": describe_chirp(),
        "audio": {"rate_hz": rate_hz, "channels": 1, "samples": round(SOUND_S * rate_hz)},
    }
    if kind == "baseband":
        manifest["baseband"] = {
            "rate_hz": BASEBAND_HZ,
            "centre_hz": CENTRE_HZ,
            "frame_samples": FRAME_SAMPLES,
            "scale": 1 / 32767,
            "source_rate_hz": rate_hz,
            "lead_s": 0.005,
        }
    return manifest


@needs_node
@pytest.mark.parametrize("kind", ["baseband", "whole"])
@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_what_the_page_keeps_is_the_sound_in_the_band(
    tmp_path: Path, rate_hz: int, kind: str
) -> None:
    sound = room_sound(rate_hz, SOUND_S)
    cut_in_node(tmp_path, sound, rate_hz, kind)
    (tmp_path / "recording.json").write_text(json.dumps(manifest_of(rate_hz, kind)))
    audio = read_recording(tmp_path).audio
    assert audio is not None
    assert audio.rate_hz == rate_hz
    assert snr_in_band_db(sound, audio.samples[0], rate_hz) > 55


@needs_node
def test_of_speech_the_page_keeps_what_python_says(tmp_path: Path) -> None:
    sound = room_sound(48_000, SOUND_S) + speech(1)
    page = page_keeps(tmp_path, sound, "baseband")
    ours = to_baseband(Audio(sound[None], 48_000), page.t_s)
    np.testing.assert_array_equal(ours.first, page.first)
    np.testing.assert_allclose(ours.scale, page.scale, rtol=1e-4)
    assert np.abs(ours.iq.astype(int) - page.iq).max() <= 4


@needs_node
@pytest.mark.parametrize("kind", ["baseband", "whole"])
def test_of_what_the_page_keeps_speech_is_understood_as_if_nobody_spoke(
    tmp_path: Path, kind: str
) -> None:
    pytest.importorskip("pystoi", reason="pystoi is not installed")
    said, quiet, stoi = speech(2), room_sound(48_000, SOUND_S), intelligibility()
    clean = down(said.astype(np.float64))
    assert stoi(clean, down((quiet + said).astype(np.float64))) > 0.8
    best = []
    for name, sound in (("spoken", quiet + said), ("quiet", quiet)):
        (tmp_path / name).mkdir()
        page = page_keeps(tmp_path / name, sound, kind)
        best.append(
            [stoi(clean, way) for made_of in FORMS.values() for way in made_of(page).values()]
        )
    assert max(best[0]) < max(best[1]) + 0.05
    assert np.mean(best[0]) < np.mean(best[1]) + 0.02


def speech(seed: int) -> np.ndarray:
    """Syllables that nobody said, as loud as the chirps."""
    return speech_like(round(SOUND_S * 48_000), 48_000, np.random.default_rng(seed), 0.1)


def page_keeps(folder: Path, sound: np.ndarray, kind: str) -> Baseband:
    """The frames of the page, those of a WAV taken down to the baseband."""
    cut_in_node(folder, sound, 48_000, kind)
    manifest = manifest_of(48_000, kind)
    if kind == "baseband":
        return read_baseband(folder, manifest["baseband"])
    (folder / "recording.json").write_text(json.dumps(manifest))
    audio = read_recording(folder).audio
    assert audio is not None
    return to_baseband(audio, np.loadtxt(folder / "frames.csv", skiprows=1))


def snr_in_band_db(sound: np.ndarray, kept: np.ndarray, rate_hz: int) -> float:
    """Level of the first frames' echoes over what differs from the sound itself, 15 to 20 kHz."""
    taps = signal.firwin(1001, (15_000, 20_000), pass_zero=False, fs=rate_hz)
    sound = signal.fftconvolve(sound, taps, mode="same")
    told = signal.fftconvolve(kept, taps, mode="same")
    power, off = 0.0, 0.0
    for frame in range(2, 9):
        start = round((0.043 + 0.1 * frame - 0.005 + 0.013) * rate_hz)
        stretch = slice(start, start + round(0.054 * rate_hz))
        power += float(np.sum(sound[stretch] ** 2))
        off += float(np.sum((sound[stretch] - told[stretch]) ** 2))
    return 10 * np.log10(power / off)

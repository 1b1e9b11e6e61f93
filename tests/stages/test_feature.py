"""Features: the spectrogram against a naive one, and encoders that work row by row."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, ELF_SIZE, Echoes
from elfslam.stages import feature
from elfslam.stages.feature import Encoder, OnnxEncoder, SpectralEncoder, load_encoder

LARGEST_SHIPPED_BYTES = 2_000_000


def traces(count: int, seed: int = 0) -> F32:
    """Traces that die away, each with its own echoes."""
    generator = np.random.default_rng(seed)
    fading = np.exp(-np.arange(ECHO_SAMPLES) / 800)
    return (0.05 * fading * generator.standard_normal((count, ECHO_SAMPLES))).astype(np.float32)


def tiny_encoder(
    *, samples: int = ECHO_SAMPLES, given: str = "samples", output: str = "elf", seed: int = 1
) -> bytes:
    """An ONNX graph that projects at random and normalises."""
    weights = np.random.default_rng(seed).normal(size=(samples, ELF_SIZE)).astype(np.float32)
    graph = helper.make_graph(
        [
            helper.make_node("MatMul", [given, "weights"], ["projected"]),
            helper.make_node("LpNormalization", ["projected"], [output], axis=1, p=2),
        ],
        "tiny",
        [helper.make_tensor_value_info(given, TensorProto.FLOAT, ["n", samples])],
        [helper.make_tensor_value_info(output, TensorProto.FLOAT, ["n", ELF_SIZE])],
        [numpy_helper.from_array(weights, "weights")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


@pytest.fixture(scope="module")
def compact() -> Encoder:
    return load_encoder("compact")


def assert_row_by_row(encoder: Encoder, rows: F32) -> None:
    """A batch gives what each row gives alone, in any order."""
    together = encoder.embed(rows)
    alone = np.vstack([encoder.embed(rows[k : k + 1]) for k in (0, 1, len(rows) - 1)])
    npt.assert_allclose(together[[0, 1, -1]], alone, atol=1e-5)
    npt.assert_allclose(encoder.embed(rows[::-1]), together[::-1], atol=1e-5)
    npt.assert_allclose(np.linalg.norm(together, axis=1), 1.0, atol=1e-5)


def test_the_spectrogram_is_the_naive_dft() -> None:
    trace, n = traces(1), np.arange(96)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * n / 96)
    frames = np.stack([trace[0, 48 * t : 48 * t + 96].astype(float) for t in range(48)])
    waves = np.exp(-2j * np.pi * np.outer(np.arange(33, 45), n) / 96)
    naive = np.abs(waves @ (window * frames).T)
    npt.assert_allclose(feature.spectrogram(trace)[0], naive, rtol=1e-3, atol=1e-6)


def test_the_spectrogram_is_that_of_scipy_between_15_and_20_khz() -> None:
    rows = traces(5)
    frequency_hz, _, oracle = signal.spectrogram(
        rows, 44_100, "hann", 96, 48, detrend=False, scaling="spectrum", mode="magnitude"
    )
    ours = feature.spectrogram(rows)
    assert ours.shape == (5, 12, 48)
    assert ours.dtype == np.float32
    npt.assert_allclose(ours, 48 * oracle[:, 33:45], rtol=1e-3, atol=1e-6)
    npt.assert_allclose(frequency_hz[[33, 44]], [15_159, 20_213], atol=1)


@pytest.mark.parametrize("row", [0, 5, 11])
def test_a_tone_lights_its_own_row_and_an_echo_its_own_column(row: int) -> None:
    tone = np.sin(2 * np.pi * (33 + row) / 96 * np.arange(ECHO_SAMPLES)).astype(np.float32)
    image = feature.spectrogram(tone[None])[0]
    assert (image.argmax(axis=0) == row).all()
    trace = np.zeros((1, ECHO_SAMPLES), dtype=np.float32)
    trace[0, 48 * 20 + 48] = 1.0
    assert feature.spectrogram(trace)[0].sum(axis=0).argmax() == 20


def test_spectral_features_are_unit_rows_row_by_row() -> None:
    encoder = SpectralEncoder()
    assert_row_by_row(encoder, traces(7))
    assert encoder.embed(traces(7)).shape == (7, 576)


@pytest.mark.parametrize("encoder", ["spectral", "compact"])
def test_the_level_does_not_matter(encoder: str) -> None:
    loaded, rows = load_encoder(encoder), traces(4)
    npt.assert_allclose(loaded.embed(20 * rows), loaded.embed(rows), atol=1e-3)


def test_a_spectral_feature_has_neither_level_nor_decay_in_any_row() -> None:
    images = SpectralEncoder().embed(traces(5)).reshape(5, 12, 48)
    npt.assert_allclose(images.mean(axis=2), 0, atol=1e-5)
    npt.assert_allclose(images @ np.linspace(-1, 1, 48), 0, atol=1e-4)


def test_silence_has_no_spectral_feature() -> None:
    assert not SpectralEncoder().embed(np.zeros((2, ECHO_SAMPLES), np.float32)).any()


def test_decay_and_colour_drop_out_but_echoes_do_not() -> None:
    encoder, rows = SpectralEncoder(), traces(2)
    faster = rows * np.exp(-np.arange(ECHO_SAMPLES) / 5_000).astype(np.float32)
    coloured = signal.lfilter([1.0, 0.3], 1.0, rows, axis=1).astype(np.float32)
    for other in (faster, coloured):
        same = np.sum(encoder.embed(rows) * encoder.embed(other), axis=1)
        assert same.min() > 0.98
    first, second = encoder.embed(rows)
    assert abs(first @ second) < 0.3


def test_an_onnx_graph_is_run_and_known_by_its_content() -> None:
    content = tiny_encoder()
    encoder, rows = OnnxEncoder(content, "tiny"), traces(300)
    weights = np.random.default_rng(1).normal(size=(ECHO_SAMPLES, ELF_SIZE))
    wanted = rows @ weights
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    npt.assert_allclose(encoder.embed(rows), wanted, atol=1e-4)
    assert_row_by_row(encoder, rows)
    assert encoder.content == content
    assert encoder.identity == OnnxEncoder(content, "the same").identity
    assert encoder.identity != OnnxEncoder(tiny_encoder(seed=2), "tiny").identity
    assert len(encoder.identity) == 16


def test_an_encoder_travels_to_another_process(compact: Encoder) -> None:
    there = pickle.loads(pickle.dumps(compact))
    assert there.identity == compact.identity
    npt.assert_array_equal(there.embed(traces(3)), compact.embed(traces(3)))


def test_no_echoes_give_no_vectors() -> None:
    assert OnnxEncoder(tiny_encoder(), "tiny").embed(traces(0)).shape == (0, ELF_SIZE)


def test_an_encoder_is_loaded_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.onnx"
    file.write_bytes(tiny_encoder())
    assert load_encoder(str(file)).identity == OnnxEncoder(tiny_encoder(), "x").identity
    assert isinstance(load_encoder("spectral"), SpectralEncoder)


def test_missing_files_and_garbage_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "garbage.onnx"
    file.write_bytes(b"not a graph at all")
    with pytest.raises(InputError, match=r"wanted compact, spectral or an ONNX file; no such file"):
        load_encoder(str(tmp_path / "none.onnx"))
    with pytest.raises(InputError, match=r"garbage.onnx: not a readable ONNX graph; pass the"):
        load_encoder(str(file))


@pytest.mark.parametrize(
    ("content", "got"),
    [
        (tiny_encoder(samples=2_000), "2000"),
        (tiny_encoder(output="vector"), "samples"),
        (tiny_encoder(given="sound"), "sound"),
    ],
)
def test_a_graph_for_something_else_is_refused(content: bytes, got: str) -> None:
    wanted = rf"other: wanted input samples \(n, 2352\) and output elf, got .*{got}.*; export it"
    with pytest.raises(InputError, match=wanted):
        OnnxEncoder(content, "other")


def test_every_echo_gets_its_feature() -> None:
    rows, t_s = traces(3), np.array([0.1, 0.2, 0.4])
    features = feature.extract_features(Echoes(t_s, rows, np.zeros((0, 2))), SpectralEncoder())
    npt.assert_array_equal(features.t_s, t_s)
    npt.assert_array_equal(features.vectors, feature.mean_normalised(SpectralEncoder().embed(rows)))
    assert features.encoder == "spectral-1"


def test_an_encoder_says_itself_what_standing_is() -> None:
    """Ten places, then standing in noise at one: one encoder tells it, the other never does."""

    class Telling(SpectralEncoder):
        still = 0.3

    rows = np.concatenate([traces(10), traces(1) + 0.3 * traces(30, seed=2)])
    echoes = Echoes(np.arange(40.0), rows, np.zeros((0, 2)))
    vectors = SpectralEncoder().embed(rows)
    told, untold = (
        feature.extract_features(echoes, each()).vectors for each in (Telling, SpectralEncoder)
    )
    npt.assert_array_equal(told, feature.mean_normalised(vectors, 0.3))
    npt.assert_array_equal(untold, feature.mean_normalised(vectors, 1.0))
    assert np.abs(told - untold).max() > 0.005


def unit(vectors: F64) -> F32:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / length, dtype=np.float32)


def test_what_a_phone_adds_to_every_echo_is_taken_away() -> None:
    """Two phones, of which each adds a vector of its own to the features of the same places."""
    generator = np.random.default_rng(5)
    places = generator.standard_normal((400, ELF_SIZE))
    added = 13 * unit(generator.standard_normal((2, ELF_SIZE)))
    first, second = (unit(places + own) for own in added)
    other = np.roll(np.arange(400), 1)

    def similarity(a: F32, b: F32) -> float:
        return float(np.mean(np.sum(a * b, axis=1)[100:]))

    assert similarity(first, first[other]) > 0.5 > similarity(first, second), "the phone is louder"
    own, theirs = feature.mean_normalised(first), feature.mean_normalised(second)
    assert similarity(own, theirs) > 0.95
    assert abs(similarity(own, theirs[other])) < 0.05


def test_only_what_was_heard_so_far_is_taken_away() -> None:
    vectors = unit(np.random.default_rng(6).standard_normal((80, ELF_SIZE)) + 0.5)
    whole = feature.mean_normalised(vectors)
    npt.assert_array_equal(whole[:50], feature.mean_normalised(vectors[:50]))
    own = vectors[40] - vectors[:41].sum(axis=0, dtype=np.float64) / (feature.PRIOR_FRAMES + 41)
    npt.assert_allclose(whole[40], unit(own), atol=1e-6)
    npt.assert_allclose(np.linalg.norm(whole, axis=1), 1.0, atol=1e-6)
    assert feature.mean_normalised(vectors[:0]).shape == (0, ELF_SIZE)


def test_what_is_heard_while_one_stands_hardly_counts() -> None:
    """A lap of places, then a minute at one of them: it is known as on the way."""
    generator = np.random.default_rng(7)
    phone = 0.5 * unit(generator.standard_normal(ELF_SIZE))
    places = unit(generator.standard_normal((60, ELF_SIZE)))
    at = np.r_[np.arange(60), np.full(600, 30)]
    heard = unit(places[at] + phone + 0.04 * generator.standard_normal((660, ELF_SIZE)))
    walked, stood = feature.mean_normalised(heard)[58:60], feature.mean_normalised(heard)[-100:]
    assert np.mean(walked @ places[58:60].T * np.eye(2)) * 2 > 0.8
    assert np.mean(stood @ places[30]) > 0.8
    counted = feature.mean_normalised(heard, still=1.0)[-100:]
    assert np.mean(counted @ places[30]) < 0.6, "every echo counts"


def test_a_phone_to_which_all_places_sound_alike_is_heard_in_the_end() -> None:
    generator = np.random.default_rng(8)
    places = unit(generator.standard_normal((3000, ELF_SIZE)))
    heard = unit(places + 3 * unit(generator.standard_normal(ELF_SIZE)))
    assert heard[0] @ heard[9] > 0.8
    assert np.mean(np.sum(feature.mean_normalised(heard)[-300:] * places[-300:], axis=1)) > 0.8


def test_the_shipped_encoder_is_small_and_works_row_by_row(compact: Encoder) -> None:
    assert len(compact.content) <= LARGEST_SHIPPED_BYTES
    assert_row_by_row(compact, traces(260))
    assert compact.embed(traces(3)).shape == (3, ELF_SIZE)


def test_the_shipped_encoder_tells_echoes_apart(compact: Encoder) -> None:
    vectors = compact.embed(traces(20))
    cosines = (vectors @ vectors.T)[~np.eye(20, dtype=bool)]
    assert cosines.mean() < 0.9


def test_a_file_of_another_maker_has_no_card(tmp_path: Path) -> None:
    (tmp_path / "tiny.onnx").write_bytes(tiny_encoder())
    assert feature.read_card(str(tmp_path / "tiny.onnx")) is None
    assert feature.read_card("spectral") is None


def heard(noise: float, seed: int) -> F32:
    """Features of a lap of 40 places, twenty echoes at each, of which the successive ones are
    `SUCCESSIVE` alike but for the noise of the phone."""
    generator = np.random.default_rng(seed)
    places = np.repeat(np.random.default_rng(1).standard_normal((40, 400)), 20, axis=0)
    own = np.sqrt(1 / feature.SUCCESSIVE - 1) * generator.standard_normal(places.shape)
    return unit(places + own + noise * generator.standard_normal(places.shape))


@pytest.mark.parametrize("noise", [0.5, 1.0, 1.8])
def test_attenuation_gives_back_what_noise_takes_of_a_mean_feature(noise: float) -> None:
    def similarity(noise: float) -> float:
        one, other = (
            heard(noise, seed).reshape(40, 20, -1).mean(axis=1)
            / feature.attenuation_of(heard(noise, seed), 3.0, feature.SUCCESSIVE)
            for seed in (2, 3)
        )
        return float(np.mean(np.sum(one * other, axis=1)))

    assert similarity(noise) == pytest.approx(similarity(0.0), rel=0.05)


def test_features_of_a_noisy_phone_say_what_noise_took_by_their_own_encoder() -> None:
    """The same echoes of one place amid noise, of a phone near its noise and of a quiet one."""
    rows = traces(1) + np.abs(traces(1)).mean() * traces(60, seed=3) / np.abs(traces(60)).mean()
    noisy = Echoes(np.arange(60.0), rows, np.zeros((0, 2)), over_noise_db=3.0)
    features = feature.extract_features(noisy, SpectralEncoder())
    wanted = feature.attenuation_of(features.vectors, 3.0, SpectralEncoder.successive)
    assert features.attenuation == wanted < 1.0
    quiet = replace(noisy, over_noise_db=20.0)
    assert feature.extract_features(quiet, SpectralEncoder()).attenuation == 1.0


def test_quiet_phones_and_unknown_noise_are_left_and_noisy_ones_corrected_so_far() -> None:
    def attenuation(noise: float, over_noise_db: float, successive: float = 0.45) -> float:
        return feature.attenuation_of(heard(noise, 4), over_noise_db, successive)

    for quiet_db in (feature.QUIET_PHONE_DB, 40.0, np.nan):
        assert attenuation(1.8, quiet_db) == 1.0
    assert attenuation(1.8, 3.0, successive=0.0) == 1.0, "an encoder by which it is not told"
    assert feature.attenuation_of(heard(1.8, 4)[:1], 3.0, 0.45) == 1.0, "a single echo"
    assert 1.0 > attenuation(1.0, 3.0) > attenuation(1.8, 3.0)
    assert attenuation(2.6, 3.0) == pytest.approx(np.sqrt(feature.LEAST_RELIABILITY))
    assert attenuation(9.0, 3.0) == 1.0, "nothing but noise"

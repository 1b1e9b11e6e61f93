"""Generic features: unit rows, each by itself, and each blind to what it should be blind to."""

import numpy as np
import pytest

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_RATE_HZ, ECHO_SAMPLES
from elfslam.baselines import generic
from elfslam.baselines.generic import COMPONENTS, decimated, generic_encoders, principal_encoder
from elfslam.stages.feature import Encoder, spectrogram

NAMES = [*generic_encoders(), "principal components"]


def traces(count: int, seed: int = 0) -> F32:
    """Decaying noise, about as loud as echoes are."""
    decay = np.exp(-np.arange(ECHO_SAMPLES) / 500)
    noise = np.random.default_rng(seed).standard_normal((count, ECHO_SAMPLES))
    return np.asarray(0.01 * noise * decay, dtype=np.float32)


def tone(hz: float) -> F32:
    t_s = np.arange(ECHO_SAMPLES) / ECHO_RATE_HZ
    return np.sin(2 * np.pi * hz * t_s, dtype=np.float32)[None]


@pytest.fixture(scope="module")
def encoders() -> dict[str, Encoder]:
    return {**generic_encoders(), "principal components": principal_encoder(traces(60, 9))}


def test_spectrograms_alone_tell_noise_by_successive_echoes(encoders: dict[str, Encoder]) -> None:
    told = {name for name, encoder in encoders.items() if encoder.successive > 0}
    assert told == {"spectrogram without mean", "root spectrogram", "log spectrogram"}


@pytest.mark.parametrize("name", NAMES)
def test_rows_are_unit_and_differ(encoders: dict[str, Encoder], name: str) -> None:
    rows = encoders[name].embed(traces(20))
    assert rows.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1.0, atol=1e-5)
    assert (rows @ rows.T)[np.triu_indices(20, 1)].max() < 0.999


@pytest.mark.parametrize("name", NAMES)
def test_an_echo_alone_is_as_in_a_batch(encoders: dict[str, Encoder], name: str) -> None:
    samples, encoder = traces(12), encoders[name]
    alone = np.concatenate([encoder.embed(samples[k : k + 1]) for k in range(12)])
    np.testing.assert_allclose(alone, encoder.embed(samples), atol=2e-6)
    np.testing.assert_allclose(encoder.embed(samples[::-1])[::-1], alone, atol=2e-6)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("gain", [0.05, 20.0])
def test_the_level_drops_out(encoders: dict[str, Encoder], name: str, gain: float) -> None:
    samples = traces(5)
    soft, loud = (encoders[name].embed(k * samples) for k in (1.0, np.float32(gain)))
    np.testing.assert_allclose(soft, loud, atol=1e-5)


@pytest.mark.parametrize("name", list(generic_encoders()))
def test_silence_gives_zeros(name: str) -> None:
    rows = generic_encoders()[name].embed(np.zeros((2, ECHO_SAMPLES), dtype=np.float32))
    assert (rows == 0).all()


def test_every_encoder_has_its_own_identity(encoders: dict[str, Encoder]) -> None:
    others = [principal_encoder(traces(60, seed)).identity for seed in (9, 10)]
    assert others[0] == encoders["principal components"].identity
    assert len({*others, *(encoder.identity for encoder in encoders.values())}) == len(NAMES) + 1


def test_decimation_keeps_tones_of_the_band_apart() -> None:
    """Every tone between 15 and 20.2 kHz stays one tone, and no two fall on each other."""
    spectra = [np.abs(np.fft.rfft(decimated(tone(hz))[0])) for hz in range(15_000, 20_300, 200)]
    peaks = [int(spectrum.argmax()) for spectrum in spectra]
    assert (np.diff(peaks) > 0).all(), "the third Nyquist zone, in order"


@pytest.mark.parametrize("hz", [15_000.0, 17_475.0, 20_250.0])
def test_a_tone_stands_at_its_frequency(hz: float) -> None:
    power = generic.power_spectral_density(tone(hz))[0]
    assert generic.PSD_BAND_HZ[0] + 75.0 * power.argmax() == pytest.approx(hz, abs=38)
    assert power.shape == (71,)


def test_the_psd_hardly_hears_when_an_echo_came() -> None:
    """That is what it lacks: the spectrogram tells an echo from the same echo 10 ms later."""
    early = np.zeros((1, ECHO_SAMPLES), dtype=np.float32)
    early[0, 600:1041] = traces(1)[0, :441]
    late = np.roll(early, 588, axis=1)
    alike = {
        name: float(encoder.embed(early)[0] @ encoder.embed(late)[0])
        for name, encoder in generic_encoders().items()
    }
    assert alike["PSD"] > 0.999
    assert alike["spectrogram"] < 0.5


def test_without_its_mean_a_spectrogram_is_no_longer_like_all_others() -> None:
    samples = np.random.default_rng(0).standard_normal((2, ECHO_SAMPLES)).astype(np.float32)
    known = generic_encoders()
    flat, mean_normalised = (
        float(np.prod(known[name].embed(samples), axis=0).sum())
        for name in ("spectrogram", "spectrogram without mean")
    )
    assert flat > 0.7
    assert abs(mean_normalised) < 0.2


def test_the_root_of_a_spectrogram_lets_what_is_loud_count_for_less() -> None:
    """Two echoes that share a loud burst and nothing else are less alike by the roots."""
    one, other = traces(2)
    burst = np.zeros(ECHO_SAMPLES, dtype=np.float32)
    burst[:96] = 0.04 * tone(17_500.0)[0, :96]
    alike = {
        name: float(np.prod(encoder.embed(np.stack([one + burst, other + burst])), axis=0).sum())
        for name, encoder in generic_encoders().items()
    }
    unlike = 1 - alike["spectrogram without mean"]
    unlike_by_roots = 1 - alike["root spectrogram"]
    assert unlike_by_roots > 3 * unlike


def test_principal_components_are_those_of_scikit_learn() -> None:
    from sklearn.decomposition import PCA

    known, asked = traces(60, 9), traces(10)

    def unit(samples: F32) -> F32:
        flat = spectrogram(samples).reshape(len(samples), -1)
        return np.asarray(flat / np.linalg.norm(flat, axis=1, keepdims=True))

    oracle = PCA(COMPONENTS, svd_solver="full").fit(unit(known)).transform(unit(asked))
    oracle /= np.linalg.norm(oracle, axis=1, keepdims=True)
    ours = principal_encoder(known).embed(asked)
    assert ours.shape == (10, COMPONENTS)
    np.testing.assert_allclose(ours @ ours.T, oracle @ oracle.T, atol=1e-4)


def test_too_few_echoes_for_components_are_refused() -> None:
    with pytest.raises(InputError, match="wanted more than 32 echoes to fit them, got 32"):
        principal_encoder(traces(32))

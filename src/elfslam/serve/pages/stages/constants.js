// Written by `python -m tests.serve.pages.constants`; edit the modules of elfslam.
// Parameters here are those of a phone that has no map; a map brings its own.

export const ACCEPTED_RATES_HZ = [44100, 48000];
export const ECHO_RATE_HZ = 44100;
export const ECHO_SAMPLES = 2352;
export const DISCARDED_SAMPLES = 485;
export const ELF_SIZE = 128;

export const CHIRP_PARAMETERS = {
  kind: "chirp",
  band_low_hz: 15000,
  band_high_hz: 20000,
  duration_s: 0.01,
  period_s: 0.1,
  fade_s: 0.001,
};

export const ECHO_PARAMETERS = {
  minimum_duration_s: 2,
  contrast: 8,
  level_share: 0.35,
  jump_share: 0.2,
  early_share: 0.5,
  early_s: 0.0015,
  slack_s: 0.002,
  latest_s: 2.5,
  found_share: 0.5,
  clipped_share: 0.001,
  seam_contrast: 9,
  shortfall_s: 0.15,
};

export const MEDIUM_ACCESS = {
  jitter_s: 0.025,
  softer_db: 4,
  slots: 8,
  listen: 8,
  forget: 100,
  check: 0.3,
  check_least: 0.08,
  check_alone: 0.05,
  free_after: 2,
  claim: 0.5,
  keep: 0.5,
  challenge: 0.05,
  stir: 0.01,
  follow: 0.05,
  contrast: 3,
  share: 0.006,
  frames: 2,
};

export const FOREIGN = {
  BIN: 16,
  GUARD: 12,
  DIRECT: 6,
  FRAME: 178,
  LULL: 193,
  QUIET: 55,
  WIDER: 3,
  NEAR_S: 0.45,
  FEWEST: 2,
  SAME: 165,
  LOUDEST_ECHO: 2,
  FADES: 0.05,
};

export const LISTENING = {
  SLACK: 88,
  LATE: 2756,
  NOISE: 6,
  STRETCHES: 16,
  LOST: 1e-06,
  REMEMBERED: 8,
};

export const FACTS = {
  QUIET: [882, 88],
  OVER: 2866,
  FULL_SCALE: 0.999,
};

export const FLOOR_VOTE = {
  vote_s: 20,
  least_lead: 0.02,
};

export const BASEBAND_FORMAT = {
  rate_hz: 6300,
  centre_hz: 17500,
  frame_samples: 504,
  lead_s: 0.005,
};

export const BASEBAND_FILTER = {
  KAISER_SHAPE: 14,
  HALF_SUPPORT_S: 0.007,
  LEAST: 1e-06,
};

export const MEAN_NORMALISATION = {
  PRIOR_FRAMES: 30,
  STILL_ECHOES: 5,
  STILL: 0.6,
  STILL_WEIGHT: 0.05,
};

export const ATTENUATION = {
  QUIET_PHONE_DB: 13,
  SUCCESSIVE: 0.45,
  LEAST_RELIABILITY: 0.36,
  NO_RELIABILITY: 0.13,
};

export const SPOOFING = {
  PARTS: 4,
  SHARPENED: 12.918740994069386,
  RECENT: 7,
  HISS: 7.7,
  CALM: 0.5,
};

export const MOTION = {
  REST_KEPT: 1.25,
  STEPS_AROUND: 5,
};

/**
 * What the stages of motion pass on. All times are seconds on the clock of the sound.
 *
 * @typedef {{tS: ArrayLike<number>, accelMps2: ArrayLike<number>, gyroRadps: ArrayLike<number>}} Imu
 *   times (n), increasing; acceleration with gravity and rate of turn (3n), x y z by turns, phone axes
 * @typedef {Float64Array[]} Axes three columns (n): x, y, z
 * @typedef {{sumRadps: number[], count: number}} Rest rates of turn summed over so many rows at rest
 * @typedef {{tS: Float64Array, accel: Axes, gyro: Axes, up: Axes, rateHz: number, biased: Axes,
 *   isStill: boolean[]}} Level even rows; the gyroscope without its bias, and with it; `up` of length 1
 * @typedef {{tS: number, fromS: number, moveM: number[], sigma: number[]}} Step from one footstep to the
 *   next: forward m, left m, turn rad, seen from the first, and the sigma of each
 * @typedef {{
 *   bounce_window_s: number, cadence_high_hz: number, cadence_low_hz: number, forward_sigma: number,
 *   gravity_cutoff_hz: number, heading_sigma_rad: number, heading_window_s: number, lateral_sigma: number,
 *   least_bounce_mps2: number, least_duration_s: number, least_interval_s: number,
 *   least_rate_hz: number, length_power_of_bounce: number, length_power_of_cadence: number,
 *   length_window_s: number, live_delay_s: number, live_window_s: number, longest_gap_s: number,
 *   longest_step_m: number, pause_intervals: number, pause_length_m: number, relative_bounce: number,
 *   setting_off_sigma_rad: number, shortest_step_m: number, step_length_m: number, step_scale: number,
 *   still_accel_mps2: number, still_gyro_radps: number, still_s: number, still_tremor_radps: number,
 *   typical_bounce_mps2: number, typical_cadence_hz: number,
 * }} MotionParameters the group "motion", as far as pages need it
 */
export {};

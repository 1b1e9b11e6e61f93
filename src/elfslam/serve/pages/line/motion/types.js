/**
 * What the stages of motion pass on. All times are seconds on the clock of the sound.
 *
 * @typedef {{tS: ArrayLike<number>, accelMps2: ArrayLike<number>, gyroRadps: ArrayLike<number>}} Imu
 *   times (n), increasing; acceleration with gravity and rate of turn (3n), x y z by turns, phone axes
 * @typedef {Float64Array[]} Axes three columns (n): x, y, z
 * @typedef {{sumRadps: number[], count: number}} Rest rates of turn summed over so many rows at rest
 * @typedef {{tS: Float64Array, accel: Axes, gyro: Axes, up: Axes, rateHz: number, biased: Axes,
 *   isStill: boolean[]}} Level even rows; the gyroscope without its bias, and with it; `up` of length 1
 * @typedef {{tS: Float64Array, worldFromBody: Float64Array, stepSigma: Float64Array}} Odometry
 *   n footsteps, their poses (3n): x m, y m, heading rad; sigma of the moves between them (3 (n-1))
 * @typedef {{tS: number, fromS: number, moveM: number[], sigma: number[]}} Step from one footstep to the
 *   next: forward m, left m, turn rad, seen from the first, and the sigma of each
 */
export {};

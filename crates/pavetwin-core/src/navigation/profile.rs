//! How speed may change: one time step of motion that can always still brake in time.

/// A stop nearer than this, in metres, is reached: rounding must not leave the agent in front of it for ever.
const REACHED_M: f64 = 1.0e-9;

/// One time step along a line towards a stop: the new speed and the way made.
///
/// Speeds up as far as `limit_mps` and `acceleration_mps2` allow, but never so far that braking at the same rate would
/// overrun the stop `remaining_m` ahead. Arrives exactly, with speed zero, after finitely many steps.
pub(super) fn step_to_stop(
    speed_mps: f64,
    limit_mps: f64,
    acceleration_mps2: f64,
    remaining_m: f64,
    dt_s: f64,
) -> (f64, f64) {
    let gain_mps = acceleration_mps2 * dt_s;
    // The largest v with v² ≤ 2 a (remaining − (speed + v) dt / 2): braking from v just reaches the stop.
    let room = 2.0 * acceleration_mps2 * remaining_m - gain_mps * speed_mps;
    if room <= 0.0 || (remaining_m <= REACHED_M && speed_mps <= gain_mps) {
        return if speed_mps <= gain_mps { (0.0, remaining_m) } else { braked(speed_mps, gain_mps, remaining_m, dt_s) };
    }
    let stoppable_mps = 2.0 * room / ((gain_mps * gain_mps + 4.0 * room).sqrt() + gain_mps);
    let wanted_mps = (speed_mps + gain_mps).min(limit_mps).min(stoppable_mps);
    let next_mps = wanted_mps.max(speed_mps - gain_mps).max(0.0);
    (next_mps, (0.5 * (speed_mps + next_mps) * dt_s).min(remaining_m))
}

/// One time step of braking as hard as allowed: the new speed and the way made.
pub(super) fn step_to_rest(speed_mps: f64, acceleration_mps2: f64, remaining_m: f64, dt_s: f64) -> (f64, f64) {
    let gain_mps = acceleration_mps2 * dt_s;
    if speed_mps <= gain_mps {
        let stopping_m = speed_mps * speed_mps / (2.0 * acceleration_mps2);
        return (0.0, stopping_m.min(remaining_m));
    }
    braked(speed_mps, gain_mps, remaining_m, dt_s)
}

fn braked(speed_mps: f64, gain_mps: f64, remaining_m: f64, dt_s: f64) -> (f64, f64) {
    let next_mps = speed_mps - gain_mps;
    (next_mps, (0.5 * (speed_mps + next_mps) * dt_s).min(remaining_m))
}

/// An angle turned towards another by at most `most_rad`, the shorter way round.
pub(super) fn turned_towards(yaw_rad: f64, target_rad: f64, most_rad: f64) -> f64 {
    let left_rad = crate::geometry::wrap_angle(target_rad - yaw_rad);
    if left_rad.abs() <= most_rad {
        target_rad
    } else {
        crate::geometry::wrap_angle(yaw_rad + left_rad.signum() * most_rad)
    }
}

//! What the way home would cost. Its length and turns are bounded by those last measured and what was flown since, so
//! that the mesh is searched only when that bound says so.

use super::settings::Settings;
use crate::geometry::Vec2;
use crate::navigation::Limits;
use std::f64::consts::PI;

/// How often the way home is weighed, seconds.
pub(super) const CHECK_S: f64 = 1.0;

/// Coming to rest, setting off for home and braking there, seconds of flight; turning comes on top.
const MANOEUVRES_S: f64 = 8.0;

/// What turning costs on top of the turn itself: slowing down before it and speeding up after it.
const TURN_ALLOWANCE: f64 = 2.0;

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct WayHome {
    /// Never less than the distance home.
    bound_m: f64,
    /// Never much less than the time that the corners on the way home cost.
    turns_s: f64,
}

impl WayHome {
    /// Away from home by what one step flew and turned.
    pub fn extend(&mut self, flown_m: f64, turned_rad: f64, transit: &Limits) {
        self.bound_m += flown_m;
        self.turns_s += TURN_ALLOWANCE * turn_s(turned_rad, transit);
    }

    /// A way from here to home: at each of its corners the UAV may have to stop, turn and set off again.
    pub fn along(way: &[Vec2], transit: &Limits) -> Self {
        let stop_s = transit.speed_mps / transit.acceleration_mps2;
        let corner_s = |corner: &[Vec2]| {
            let (before, after) = (corner[1] - corner[0], corner[2] - corner[1]);
            stop_s + turn_s(before.cross(after).atan2(before.dot(after)), transit)
        };
        Self {
            bound_m: way.windows(2).map(|leg| leg[0].distance(leg[1])).sum(),
            turns_s: way.windows(3).map(corner_s).sum(),
        }
    }

    /// Share of the battery that flying home from here and landing drains, at most.
    pub fn cost(&self, altitude_m: f64, settings: &Settings) -> f64 {
        settings.battery.drain.home(
            self.bound_m,
            settings.transit.least_speed_mps(),
            altitude_m,
            settings.climb_speed_mps,
            MANOEUVRES_S + turn_s(PI, &settings.transit) + self.turns_s,
        )
    }
}

fn turn_s(turned_rad: f64, transit: &Limits) -> f64 {
    turned_rad.abs() / transit.yaw_rate_rad_s
}

//! Flying by hand: what a pilot asks for, and one time step of it.

use super::settings::Settings;
use super::uav::UavState;
use crate::geometry::{Vec2, wrap_angle};
use crate::navigation::{Avoider, NavMesh, Neighbour};

/// Below this speed the UAV stands, where nothing is asked for.
const STANDING_MPS: f64 = 0.01;

/// What a pilot asks for, as the UAV looks.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Steer {
    pub ahead_mps: f64,
    pub left_mps: f64,
    /// Counter-clockwise.
    pub turn_rad_s: f64,
}

impl Steer {
    /// What is not finite counts as nothing.
    fn finite(self) -> Self {
        let known = |value: f64| if value.is_finite() { value } else { 0.0 };
        Self { ahead_mps: known(self.ahead_mps), left_mps: known(self.left_mps), turn_rad_s: known(self.turn_rad_s) }
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Steering {
    wanted: Steer,
    pub velocity_mps: Vec2,
}

impl Steering {
    pub fn from_rest(wanted: Steer) -> Self {
        Self { wanted: wanted.finite(), velocity_mps: Vec2::ZERO }
    }

    pub fn ask(&mut self, wanted: Steer) {
        self.wanted = wanted.finite();
    }

    /// One time step within the limits of transit, on the mesh, and clear of others: it brakes before a border, and
    /// slides along it.
    pub fn step(
        &mut self,
        mesh: &NavMesh,
        uav: &mut UavState,
        settings: &Settings,
        neighbours: &[Neighbour],
        dt_s: f64,
    ) {
        let limits = settings.transit;
        let most_rad_s = limits.yaw_rate_rad_s;
        uav.yaw_rad = wrap_angle(uav.yaw_rad + self.wanted.turn_rad_s.clamp(-most_rad_s, most_rad_s) * dt_s);
        let ahead = Vec2::from_yaw(uav.yaw_rad);
        let asked = ahead * self.wanted.ahead_mps + ahead.left() * self.wanted.left_mps;
        let speed_mps = asked.length().min(limits.speed_towards(asked.yaw_rad()));
        let preferred_mps = asked.normalized() * speed_mps;
        let avoider = Avoider { radius_m: settings.radius_m, limits };
        let (position, velocity_mps) =
            avoider.step(mesh, uav.position, self.velocity_mps, preferred_mps, neighbours, dt_s);
        let stands = speed_mps == 0.0 && velocity_mps.length() < STANDING_MPS;
        self.velocity_mps = if stands { Vec2::ZERO } else { velocity_mps };
        uav.position = if stands { uav.position } else { position };
        uav.speed_mps = self.velocity_mps.length();
    }
}

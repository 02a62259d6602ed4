//! The agent on its rail: turns, speeds up, keeps the limits, brakes and arrives.

use super::profile::{step_to_rest, step_to_stop, turned_towards};
use super::rail::{Limits, Rail};
use crate::geometry::{Vec2, wrap_angle};

/// A movement in progress, advanced in steps of time.
///
/// Between two steps the speed changes by no more than acceleration · dt, the yaw by no more than yaw rate · dt, and
/// the position stays on the mesh the movement was planned on.
pub trait Motion {
    /// Advances by `dt_s` seconds (zero or more; 0.05 is usual).
    fn step(&mut self, dt_s: f64);
    /// Comes to rest as fast as allowed, and stays there until [`Self::resume`].
    fn brake(&mut self);
    /// Goes on after [`Self::brake`].
    fn resume(&mut self);
    /// Where the agent is, in metres.
    fn position(&self) -> Vec2;
    /// Which way it looks, counter-clockwise from east, in (−π, π].
    fn yaw_rad(&self) -> f64;
    /// How fast it moves, in m/s.
    fn speed_mps(&self) -> f64;
    /// Its velocity over the ground, in m/s.
    fn velocity_mps(&self) -> Vec2;
    /// The way still to go, in metres.
    fn remaining_m(&self) -> f64;
    /// Whether it stands at its goal, turned as it should be.
    fn arrived(&self) -> bool;
    /// Whether it stands and turns on the spot.
    fn turning(&self) -> bool;
}

/// Follows a [`Rail`]: first turns on the spot to the rail's direction, then flies along it and comes to rest at its
/// end.
#[derive(Debug, Clone, PartialEq)]
pub struct Follower {
    rail: Rail,
    /// The piece of the rail the agent is on.
    piece: usize,
    /// The point of the rail at which it next comes to rest.
    stop: usize,
    s_m: f64,
    position: Vec2,
    yaw_rad: f64,
    speed_mps: f64,
    /// The direction to turn to, while the agent stands and turns.
    turn_to_rad: Option<f64>,
    braking: bool,
}

impl Follower {
    /// At rest at the start of `rail`, looking towards `yaw_rad`.
    pub fn new(rail: Rail, yaw_rad: f64) -> Self {
        let position = rail.points()[0];
        let turn_to_rad = rail.initial_yaw_rad();
        let stop = rail.stop_after(0);
        Self {
            rail,
            piece: 0,
            stop,
            s_m: 0.0,
            position,
            yaw_rad: wrap_angle(yaw_rad),
            speed_mps: 0.0,
            turn_to_rad,
            braking: false,
        }
    }

    /// Already moving along `rail` at `speed_mps` (cut to what the rail allows at its start), looking along it.
    pub fn moving(rail: Rail, speed_mps: f64) -> Self {
        let speed_mps = speed_mps.clamp(0.0, rail.speed_limit(0.0));
        let mut follower = Self::new(rail, 0.0);
        follower.yaw_rad = follower.turn_to_rad.take().unwrap_or(0.0);
        follower.speed_mps = speed_mps;
        follower
    }

    /// The rail being followed.
    pub fn rail(&self) -> &Rail {
        &self.rail
    }

    /// The way made along the rail, in metres.
    pub fn s_m(&self) -> f64 {
        self.s_m
    }

    fn advance(&mut self, limits: Limits, dt_s: f64) {
        let to_stop_m = self.rail.distance_at(self.stop) - self.s_m;
        let (speed_mps, way_m) = if self.braking {
            step_to_rest(self.speed_mps, limits.acceleration_mps2, to_stop_m, dt_s)
        } else {
            let limit_mps = self.allowed_mps(limits, to_stop_m, dt_s);
            step_to_stop(self.speed_mps, limit_mps, limits.acceleration_mps2, to_stop_m, dt_s)
        };
        self.speed_mps = speed_mps;
        self.s_m += way_m;
        let stops_here = way_m >= to_stop_m;
        if stops_here {
            (self.s_m, self.speed_mps) = (self.rail.distance_at(self.stop), 0.0);
        }
        self.piece = self.rail.piece_from(self.piece, self.s_m).min(self.stop.saturating_sub(1));
        let (position, tangent_rad) = self.rail.sample_on(self.piece, self.s_m);
        self.position = position;
        self.yaw_rad = turned_towards(self.yaw_rad, tangent_rad, limits.yaw_rate_rad_s * dt_s);
        if stops_here {
            self.leave_stop();
        }
    }

    /// At a sharp corner the agent takes up the next piece and turns to it; at the end nothing is left to do.
    fn leave_stop(&mut self) {
        if let Some(yaw_rad) = self.rail.yaw_after(self.stop) {
            self.turn_to_rad = Some(yaw_rad);
            self.piece = self.stop;
            self.stop = self.rail.stop_after(self.piece);
        }
    }

    /// The highest speed after this step for which the rail's limit holds at the place then reached.
    fn allowed_mps(&self, limits: Limits, to_stop_m: f64, dt_s: f64) -> f64 {
        let keeps = |speed_mps: f64| {
            let way_m = (0.5 * (self.speed_mps + speed_mps) * dt_s).min(to_stop_m);
            let s_m = self.s_m + way_m;
            let limit = self.rail.limit_on(self.rail.piece_from(self.piece, s_m), s_m);
            speed_mps * speed_mps <= limit
        };
        let gain_mps = limits.acceleration_mps2 * dt_s;
        let mut high = (self.speed_mps + gain_mps).min(limits.speed_mps);
        if keeps(high) {
            return high;
        }
        let mut low = (self.speed_mps - gain_mps).max(0.0);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if keeps(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
}

impl Motion for Follower {
    fn step(&mut self, dt_s: f64) {
        if dt_s <= 0.0 {
            return;
        }
        let limits = self.rail.limits();
        if let Some(target_rad) = self.turn_to_rad {
            self.yaw_rad = turned_towards(self.yaw_rad, target_rad, limits.yaw_rate_rad_s * dt_s);
            if self.yaw_rad == target_rad {
                self.turn_to_rad = None;
            }
        } else if self.s_m < self.rail.length_m() {
            self.advance(limits, dt_s);
        } else {
            self.speed_mps = 0.0; // rounding may bring it to the end with a breath of speed left
        }
    }

    fn brake(&mut self) {
        self.braking = true;
    }

    fn resume(&mut self) {
        self.braking = false;
    }

    fn position(&self) -> Vec2 {
        self.position
    }

    fn yaw_rad(&self) -> f64 {
        self.yaw_rad
    }

    fn speed_mps(&self) -> f64 {
        self.speed_mps
    }

    fn velocity_mps(&self) -> Vec2 {
        Vec2::from_yaw(self.rail.sample_on(self.piece, self.s_m).1) * self.speed_mps
    }

    fn remaining_m(&self) -> f64 {
        self.rail.length_m() - self.s_m
    }

    fn arrived(&self) -> bool {
        self.s_m >= self.rail.length_m() && self.turn_to_rad.is_none()
    }

    fn turning(&self) -> bool {
        self.turn_to_rad.is_some()
    }
}

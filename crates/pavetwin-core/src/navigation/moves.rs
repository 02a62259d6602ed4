//! Movements without a rail: a straight displacement with the nose held still, and a turn on the spot.

use super::error::NavMeshError;
use super::follower::Motion;
use super::mesh::NavMesh;
use super::profile::{step_to_rest, step_to_stop, turned_towards};
use super::rail::Limits;
use crate::geometry::{Vec2, wrap_angle};

/// A straight movement from rest to rest that does not turn: the speed rises, holds and falls (a trapezoid).
#[derive(Debug, Clone, PartialEq)]
pub struct Strafe {
    from: Vec2,
    along: Vec2,
    length_m: f64,
    s_m: f64,
    speed_mps: f64,
    yaw_rad: f64,
    limits: Limits,
    braking: bool,
}

impl Strafe {
    /// From `from` to `to`, looking towards `yaw_rad` all the way.
    ///
    /// # Errors
    /// [`NavMeshError::StartOutside`], [`NavMeshError::GoalOutside`], [`NavMeshError::LeavesMesh`] when the straight
    /// line is not on the mesh, [`NavMeshError::BadConfig`] when a limit is not positive.
    pub fn new(mesh: &NavMesh, from: Vec2, to: Vec2, yaw_rad: f64, limits: &Limits) -> Result<Self, NavMeshError> {
        limits.check()?;
        let start = mesh.snapped(from).ok_or(NavMeshError::StartOutside { x: from.x, y: from.y })?;
        let goal = mesh.snapped(to).ok_or(NavMeshError::GoalOutside { x: to.x, y: to.y })?;
        if !mesh.segment_inside(start, goal) {
            return Err(NavMeshError::LeavesMesh { from, to });
        }
        let along = (goal - start).normalized();
        Ok(Self {
            from: start,
            along,
            length_m: start.distance(goal),
            s_m: 0.0,
            speed_mps: 0.0,
            yaw_rad: wrap_angle(yaw_rad),
            limits: Limits { speed_mps: limits.speed_towards(along.yaw_rad()), ..*limits },
            braking: false,
        })
    }
}

impl Motion for Strafe {
    fn step(&mut self, dt_s: f64) {
        let (remaining_m, acceleration_mps2) = (self.remaining_m(), self.limits.acceleration_mps2);
        if dt_s <= 0.0 {
            return;
        }
        if remaining_m <= 0.0 {
            self.speed_mps = 0.0;
            return;
        }
        let (speed_mps, way_m) = if self.braking {
            step_to_rest(self.speed_mps, acceleration_mps2, remaining_m, dt_s)
        } else {
            step_to_stop(self.speed_mps, self.limits.speed_mps, acceleration_mps2, remaining_m, dt_s)
        };
        self.speed_mps = speed_mps;
        self.s_m += way_m;
        if way_m >= remaining_m {
            (self.s_m, self.speed_mps) = (self.length_m, 0.0);
        }
    }

    fn brake(&mut self) {
        self.braking = true;
    }

    fn resume(&mut self) {
        self.braking = false;
    }

    fn position(&self) -> Vec2 {
        self.from + self.along * self.s_m
    }

    fn yaw_rad(&self) -> f64 {
        self.yaw_rad
    }

    fn speed_mps(&self) -> f64 {
        self.speed_mps
    }

    fn velocity_mps(&self) -> Vec2 {
        self.along * self.speed_mps
    }

    fn remaining_m(&self) -> f64 {
        self.length_m - self.s_m
    }

    fn arrived(&self) -> bool {
        self.s_m >= self.length_m
    }

    fn turning(&self) -> bool {
        false
    }
}

/// A turn on the spot at the yaw rate, the shorter way round.
#[derive(Debug, Clone, PartialEq)]
pub struct TurnTo {
    position: Vec2,
    yaw_rad: f64,
    target_rad: f64,
    yaw_rate_rad_s: f64,
    braking: bool,
}

impl TurnTo {
    /// Standing at `position`, from `yaw_rad` to `target_rad`.
    pub fn new(position: Vec2, yaw_rad: f64, target_rad: f64, limits: &Limits) -> Self {
        let (yaw_rad, target_rad) = (wrap_angle(yaw_rad), wrap_angle(target_rad));
        Self { position, yaw_rad, target_rad, yaw_rate_rad_s: limits.yaw_rate_rad_s, braking: false }
    }
}

impl Motion for TurnTo {
    fn step(&mut self, dt_s: f64) {
        if !self.braking {
            self.yaw_rad = turned_towards(self.yaw_rad, self.target_rad, self.yaw_rate_rad_s * dt_s.max(0.0));
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
        0.0
    }

    fn velocity_mps(&self) -> Vec2 {
        Vec2::ZERO
    }

    fn remaining_m(&self) -> f64 {
        0.0
    }

    fn arrived(&self) -> bool {
        self.yaw_rad == self.target_rad
    }

    fn turning(&self) -> bool {
        !self.braking && !self.arrived()
    }
}

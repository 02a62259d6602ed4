//! The command in progress, and one time step of it.

use super::course::{nearest_reachable, shortened};
use super::error::FlightError;
use super::settings::Settings;
use super::steering::Steering;
use super::uav::UavState;
use crate::geometry::Vec2;
use crate::navigation::{Follower, Limits, Motion, NavMesh, Rail, Strafe, TurnTo};

/// A place to fly to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Destination {
    pub goal: Vec2,
    /// Stop at the stopping distance before it.
    pub stop_short: bool,
}

#[derive(Debug, Clone)]
pub(super) enum Task {
    Idle,
    Climb {
        to_m: f64,
    },
    Rail(Box<Follower>),
    Turn(TurnTo),
    Stay {
        until_tick: u64,
    },
    /// By hand, until another command.
    Steer(Steering),
    /// Comes to rest first, then flies to the destination.
    Halt {
        moving: Moving,
        then: Destination,
    },
}

/// A movement that a command cuts short.
#[derive(Debug, Clone)]
pub(super) enum Moving {
    Rail(Box<Follower>),
    Strafe(Strafe),
}

impl Moving {
    fn motion(&self) -> &dyn Motion {
        match self {
            Self::Rail(follower) => &**follower,
            Self::Strafe(strafe) => strafe,
        }
    }

    fn motion_mut(&mut self) -> &mut dyn Motion {
        match self {
            Self::Rail(follower) => &mut **follower,
            Self::Strafe(strafe) => strafe,
        }
    }
}

impl Task {
    /// A flight along a line on the mesh, from rest.
    pub fn along(mesh: &NavMesh, uav: &UavState, line: &[Vec2], limits: &Limits) -> Result<Self, FlightError> {
        let rail = Rail::new(mesh, line, limits)?;
        Ok(Self::Rail(Box::new(Follower::new(rail, uav.yaw_rad))))
    }

    /// The shortest way to a place or to the nearest one that can be reached, at transit speed, from rest.
    pub fn to(
        mesh: &NavMesh,
        uav: &UavState,
        destination: Destination,
        settings: &Settings,
    ) -> Result<Self, FlightError> {
        let way = mesh.path(uav.position, nearest_reachable(mesh, uav.position, destination.goal))?;
        let way = if destination.stop_short { shortened(&way, settings.stopping_distance_m) } else { way };
        Self::along(mesh, uav, &way, &settings.transit)
    }

    pub fn is_done(&self, uav: &UavState, tick: u64) -> bool {
        match self {
            Self::Idle => true,
            Self::Climb { to_m } => uav.altitude_m == *to_m,
            Self::Rail(follower) => follower.arrived(),
            Self::Turn(turn) => turn.arrived(),
            Self::Stay { until_tick } => tick >= *until_tick,
            Self::Halt { .. } | Self::Steer(_) => false,
        }
    }

    /// One time step of all but steering, which needs more to go by; answers where to fly now that the movement before
    /// has come to rest.
    pub fn step(&mut self, uav: &mut UavState, climb_speed_mps: f64, dt_s: f64) -> Option<Destination> {
        match self {
            Self::Idle | Self::Stay { .. } => uav.speed_mps = 0.0,
            Self::Climb { to_m } => {
                let most_m = climb_speed_mps * dt_s;
                uav.altitude_m += (*to_m - uav.altitude_m).clamp(-most_m, most_m);
                uav.speed_mps = 0.0;
            }
            Self::Turn(turn) => {
                turn.step(dt_s);
                uav.yaw_rad = turn.yaw_rad();
                uav.speed_mps = 0.0;
            }
            Self::Steer(_) => {}
            Self::Rail(follower) => {
                follower.resume();
                follower.step(dt_s);
                uav.take_pose(&**follower);
            }
            Self::Halt { moving, then } => {
                let motion = moving.motion_mut();
                motion.brake();
                motion.step(dt_s);
                uav.take_pose(motion);
                return (uav.speed_mps == 0.0).then_some(*then);
            }
        }
        None
    }

    /// One time step of coming to rest on the line, and of resting there.
    pub fn brake(&mut self, uav: &mut UavState, dt_s: f64) {
        if let Self::Rail(follower) = self {
            follower.brake();
            follower.step(dt_s);
            uav.take_pose(&**follower);
        }
    }

    /// The line in flight.
    pub fn follower(&self) -> Option<&Follower> {
        if let Self::Rail(follower) = self { Some(follower) } else { None }
    }

    /// The movement that a new command would have to cut short.
    pub fn moving(&self) -> Option<Moving> {
        match self {
            Self::Rail(follower) => Some(Moving::Rail(follower.clone())),
            Self::Halt { moving, .. } => Some(moving.clone()),
            _ => None,
        }
    }

    /// Over the ground.
    pub fn velocity_mps(&self) -> Vec2 {
        match self {
            Self::Rail(follower) => follower.velocity_mps(),
            Self::Halt { moving, .. } => moving.motion().velocity_mps(),
            Self::Steer(steering) => steering.velocity_mps,
            _ => Vec2::ZERO,
        }
    }
}

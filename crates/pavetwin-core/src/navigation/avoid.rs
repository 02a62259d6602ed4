//! Keeping clear of other agents at the UAV's altitude: optimal reciprocal collision avoidance (van den Berg, Guy, Lin,
//! Manocha 2011) by the crate `dodgy_2d`.

use std::borrow::Cow;

use super::mesh::{NavMesh, closest_on_segment};
use super::rail::Limits;
use crate::geometry::Vec2;

/// How far ahead encounters with other agents are looked for, in seconds.
const HORIZON_S: f64 = 4.0;
/// The border of the mesh is kept off by this much while avoiding, in metres; behind it the border itself holds.
const WALL_MARGIN_M: f64 = 0.05;

/// How far the preferred velocity turns to the right when an agent is straight ahead.
const KEEP_RIGHT_RAD: f64 = 0.2;

/// Another agent at the UAV's own altitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbour {
    /// Its centre, in metres.
    pub position: Vec2,
    /// Its velocity, in m/s.
    pub velocity_mps: Vec2,
    /// The radius of the circle around it, in metres.
    pub radius_m: f64,
}

/// Steers the UAV around agents that do not give way: the UAV does all of the avoiding.
///
/// To be used while such an agent is near; afterwards the route is planned again from where the UAV then is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Avoider {
    /// Radius of the UAV, in metres.
    pub radius_m: f64,
    /// Speed and acceleration it may use. The yaw is free: a multirotor can fly sideways.
    pub limits: Limits,
}

impl Avoider {
    /// One step of `dt_s` seconds from `position` with `velocity_mps`, preferring `preferred_mps`: the new position and
    /// velocity.
    ///
    /// The velocity changes by at most acceleration · dt, except that at the border of the mesh, the last resort, the
    /// part of it that points outwards is lost at once. The position always stays on the mesh.
    pub fn step(
        &self,
        mesh: &NavMesh,
        position: Vec2,
        velocity_mps: Vec2,
        preferred_mps: Vec2,
        neighbours: &[Neighbour],
        dt_s: f64,
    ) -> (Vec2, Vec2) {
        if dt_s <= 0.0 {
            return (position, velocity_mps);
        }
        let preferred_mps = self.keeping_right(position, preferred_mps, neighbours);
        let advised = self.clear_velocity(mesh, position, velocity_mps, preferred_mps, neighbours, dt_s);
        let change = advised - velocity_mps;
        let most_mps = self.limits.acceleration_mps2 * dt_s;
        let next_mps =
            if change.length() <= most_mps { advised } else { velocity_mps + change.normalized() * most_mps };
        kept_inside(mesh, position, next_mps, dt_s)
    }

    /// Straight in front of an agent left and right are equally good, and ORCA would stand still: a little to the right
    /// then, as the rules of the air have it.
    fn keeping_right(&self, position: Vec2, preferred_mps: Vec2, neighbours: &[Neighbour]) -> Vec2 {
        let ahead = preferred_mps.normalized();
        let faced = neighbours.iter().any(|neighbour| {
            let offset = neighbour.position - position;
            let near = offset.length() <= HORIZON_S * self.limits.speed_mps;
            near && ahead.dot(offset) > 0.0 && ahead.cross(offset).abs() < 0.25 * (self.radius_m + neighbour.radius_m)
        });
        if !faced {
            return preferred_mps;
        }
        let (sin, cos) = KEEP_RIGHT_RAD.sin_cos();
        preferred_mps * cos - preferred_mps.left() * sin
    }

    /// What ORCA advises, without regard to acceleration.
    fn clear_velocity(
        &self,
        mesh: &NavMesh,
        position: Vec2,
        velocity_mps: Vec2,
        preferred_mps: Vec2,
        neighbours: &[Neighbour],
        dt_s: f64,
    ) -> Vec2 {
        // Single precision is enough when measured from the UAV.
        let single = |v: Vec2| dodgy_2d::Vec2::new(v.x as f32, v.y as f32);
        let own = dodgy_2d::Agent {
            position: dodgy_2d::Vec2::ZERO,
            velocity: single(velocity_mps),
            radius: self.radius_m as f32,
            avoidance_responsibility: 1.0,
        };
        let others: Vec<Cow<'_, dodgy_2d::Agent>> = neighbours
            .iter()
            .map(|neighbour| {
                Cow::Owned(dodgy_2d::Agent {
                    position: single(neighbour.position - position),
                    velocity: single(neighbour.velocity_mps),
                    radius: neighbour.radius_m as f32,
                    avoidance_responsibility: 0.0,
                })
            })
            .collect();
        // Walls count as far ahead as it takes to brake for them.
        let braking_s = self.limits.speed_mps / self.limits.acceleration_mps2;
        let wall_horizon_s = braking_s + 2.0 * dt_s;
        let reach_m = self.limits.speed_mps * wall_horizon_s + 1.0;
        // A wall has the mesh on its left, an obstacle its solid side: so the ends are swapped.
        let walls: Vec<Cow<'_, dodgy_2d::Obstacle>> = mesh
            .walls_near(position, reach_m)
            .into_iter()
            .map(|[a, b]| {
                Cow::Owned(dodgy_2d::Obstacle::Open { vertices: vec![single(b - position), single(a - position)] })
            })
            .collect();
        let options = dodgy_2d::AvoidanceOptions {
            obstacle_margin: WALL_MARGIN_M as f32,
            time_horizon: HORIZON_S as f32,
            obstacle_time_horizon: wall_horizon_s as f32,
        };
        let speed_mps = self.limits.speed_mps as f32;
        let clear =
            own.compute_avoiding_velocity(&others, &walls, single(preferred_mps), speed_mps, dt_s as f32, &options);
        if clear.is_finite() { Vec2::new(clear.x.into(), clear.y.into()) } else { Vec2::ZERO }
    }
}

/// The step made, or as much of it as the border allows: along the border, else none.
fn kept_inside(mesh: &NavMesh, position: Vec2, velocity_mps: Vec2, dt_s: f64) -> (Vec2, Vec2) {
    let next = position + velocity_mps * dt_s;
    if mesh.segment_inside(position, next) {
        return (next, velocity_mps);
    }
    let way_m = position.distance(next);
    let slid = mesh.nearest(next);
    if slid.distance(position) <= way_m && mesh.segment_inside(position, slid) {
        return (slid, (slid - position) * (1.0 / dt_s));
    }
    let walls = mesh.walls_near(position, way_m + WALL_MARGIN_M);
    let along = walls.iter().map(|wall| {
        let direction = (wall[1] - wall[0]).normalized();
        closest_on_segment(position + direction * direction.dot(velocity_mps * dt_s), *wall)
    });
    along
        .filter(|point| point.distance(position) <= way_m && mesh.segment_inside(position, *point))
        .max_by(|a, b| (*a - position).dot(velocity_mps).total_cmp(&(*b - position).dot(velocity_mps)))
        .map_or((position, Vec2::ZERO), |point| (point, (point - position) * (1.0 / dt_s)))
}

//! Where the UAV may fly and how it moves there: navigation mesh, routes, rails, kinematics, avoidance.
//!
//! - [`NavMesh`] holds the flat flight domain at one altitude as convex polygons, baked by Recast ([`NavMesh::bake`]),
//!   and answers what lies inside, what is nearest and which way is shortest ([`NavMesh::path`]).
//! - [`Rail`] makes such a path flyable: corners become arcs, and a speed limit runs along it.
//! - [`Follower`], [`Strafe`] and [`TurnTo`] are the agent's kinematics, all behind the one trait [`Motion`].
//! - [`Avoider`] steers around agents at the UAV's own altitude by ORCA.
//!
//! Positions are east-north in metres, angles counter-clockwise from east in radians.

mod assembly;
mod avoid;
mod bake;
mod bake_config;
mod corners;
mod error;
mod follower;
mod grid;
mod mesh;
mod moves;
mod profile;
mod rail;
mod search;
mod sight;
mod sightlines;
mod tile;

pub use assembly::BORDER_TOLERANCE_M;
pub use avoid::{Avoider, Neighbour};
pub use bake_config::BakeConfig;
pub use error::NavMeshError;
pub use follower::{Follower, Motion};
pub use mesh::NavMesh;
pub use moves::{Strafe, TurnTo};
pub use rail::{Limits, Rail};

//! Random scenes, and the short ways to build small ones.

use crate::support::{DEFAULT, PAPER};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{
    AcrossRule, AgentPose, Body, BodyClass, NadirCamera, Observer, Prism, Scene, Solids, SurfaceGrid, Trace,
    TraceColumns, Viewpoint, Visibility, WindowRule,
};
use proptest::prelude::*;

pub const CAR: Body = Body { class: BodyClass::Vehicle, length_m: 4.6, width_m: 1.8, height_m: 1.5, base_m: 0.0 };
pub const TRUCK: Body = Body { class: BodyClass::Vehicle, length_m: 7.1, width_m: 2.4, height_m: 3.4, base_m: 0.0 };
pub const WALKER: Body =
    Body { class: BodyClass::Pedestrian, length_m: 0.22, width_m: 0.48, height_m: 1.72, base_m: 0.0 };

/// An agent that stands or moves: body, position, yaw, speed.
pub type Placed = (Body, Vec2, f64, f64);

pub fn viewpoint(x: f64, y: f64, altitude_m: f64, yaw_rad: f64) -> Viewpoint {
    Viewpoint { position: Vec2::new(x, y), altitude_m, yaw_rad }
}

/// A recording of one step at time 0.
pub fn standing(agents: &[Placed]) -> Trace {
    Trace::new(TraceColumns {
        step_s: 0.5,
        step_offsets: vec![0, agents.len() as u32],
        agent: (0..agents.len() as u32).collect(),
        x_m: agents.iter().map(|agent| agent.1.x).collect(),
        y_m: agents.iter().map(|agent| agent.1.y).collect(),
        yaw_rad: agents.iter().map(|agent| agent.2 as f32).collect(),
        speed_mps: agents.iter().map(|agent| agent.3 as f32).collect(),
        bodies: agents.iter().map(|agent| agent.0).collect(),
    })
    .expect("a trace")
}

/// The trace's own poses: what the kernel was given, single precision of the yaw included.
pub fn poses(trace: &Trace) -> Vec<AgentPose> {
    trace.agents_at(0.0).expect("time 0")
}

pub fn ring(corners: &[(f64, f64)]) -> Vec<Vec2> {
    corners.iter().map(|&(x, y)| Vec2::new(x, y)).collect()
}

/// A straight street of 60 m by 14 m about the origin, with a round-about's island cut out.
pub fn street() -> SurfaceGrid {
    let outline = ring(&[(-30.0, -7.0), (30.0, -7.0), (30.0, 7.0), (-30.0, 7.0)]);
    let island = ring(&[(3.0, -2.0), (5.0, -2.0), (4.0, 1.0)]);
    SurfaceGrid::from_rings(&[outline, island], 0.25).expect("a grid")
}

pub fn look(
    grid: &SurfaceGrid,
    solids: &Solids,
    trace: &Trace,
    camera: &NadirCamera,
    from: &Viewpoint,
) -> (Observer, Visibility) {
    let mut observer = Observer::new();
    let scene = Scene { grid, solids, trace };
    let visibility = observer.observe(&scene, camera, from, 0.0).expect("a look");
    (observer, visibility)
}

/// A regular polygon, turned.
pub fn regular(centre: Vec2, radius_m: f64, corners: u32, turn_rad: f64) -> Vec<Vec2> {
    let corner = |i: u32| Vec2::from_yaw(turn_rad + std::f64::consts::TAU * f64::from(i) / f64::from(corners));
    (0..corners).map(|i| centre + corner(i) * radius_m).collect()
}

pub fn any_place(half_m: f64) -> impl Strategy<Value = Vec2> {
    (-half_m..half_m, -half_m..half_m).prop_map(|(x, y)| Vec2::new(x, y))
}

pub fn any_agent() -> impl Strategy<Value = Placed> {
    let body = (any::<bool>(), 0.3..12.0, 0.3..2.6, 0.6..4.5, prop_oneof![3 => Just(0.0), 1 => 0.1..5.0]);
    (body, any_place(16.0), -7.0..7.0, 0.0..20.0).prop_map(
        |((walks, length_m, width_m, tall_m, base_m), at, yaw, speed)| {
            let class = if walks { BodyClass::Pedestrian } else { BodyClass::Vehicle };
            (Body { class, length_m, width_m, height_m: base_m + tall_m, base_m }, at, yaw, speed)
        },
    )
}

pub fn any_agents() -> impl Strategy<Value = Vec<Placed>> {
    prop::collection::vec(any_agent(), 0..12)
}

pub fn any_prism() -> impl Strategy<Value = Prism> {
    let shape = (any_place(16.0), 0.05..4.0, 3u32..9, 0.0..6.3);
    (shape, prop_oneof![Just(0.0), 0.5..6.0], 0.5..20.0).prop_map(|((at, radius, corners, turn), base_m, tall_m)| {
        Prism::new(regular(at, radius, corners, turn), base_m, base_m + tall_m).expect("a prism")
    })
}

/// A parked vehicle, in any direction.
pub fn any_parked() -> impl Strategy<Value = Prism> {
    (any_place(12.0), -7.0..7.0, 2.0..7.0, 0.8..2.4, 1.2..3.5).prop_map(|(at, yaw, length_m, width_m, height_m)| {
        let (along, across) = (Vec2::from_yaw(yaw) * (0.5 * length_m), Vec2::from_yaw(yaw).left() * (0.5 * width_m));
        let base = vec![at + along + across, at - along + across, at - along - across, at + along - across];
        Prism::new(base, 0.0, height_m).expect("a prism")
    })
}

/// Low enough that some bodies reach above the camera, high enough for the usual flight.
pub fn any_viewpoint() -> impl Strategy<Value = Viewpoint> {
    (any_place(6.0), prop_oneof![1.0..4.0, 4.0..20.0], -4.0..4.0)
        .prop_map(|(position, altitude_m, yaw_rad)| Viewpoint { position, altitude_m, yaw_rad })
}

pub fn any_rule() -> impl Strategy<Value = WindowRule> {
    prop_oneof![
        Just(PAPER),
        Just(DEFAULT),
        (0.05..1.0, 0.05..1.0)
            .prop_map(|(rows_share, columns)| WindowRule { rows_share, across: AcrossRule::Columns(columns) }),
    ]
}

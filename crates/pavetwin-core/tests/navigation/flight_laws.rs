//! What must hold of every flight over a mesh.

use pavetwin_core::geometry::{Vec2, wrap_angle};
use pavetwin_core::navigation::{
    Avoider, Follower, Limits, Motion, NavMesh, NavMeshError, Neighbour, Rail, Strafe, TurnTo,
};
use proptest::prelude::*;

use crate::scenes::{any_board, any_corridors, any_shares, config, point_of, square_mesh};
use crate::support::AGENT;

const DT_S: f64 = 0.05;

/// Flies to the end, checking every step; the time it took, in seconds.
fn fly(
    mesh: &NavMesh,
    motion: &mut dyn Motion,
    limits: Limits,
    mut before_step: impl FnMut(usize, &mut dyn Motion),
) -> f64 {
    for step in 0..200_000 {
        if motion.arrived() {
            return step as f64 * DT_S;
        }
        before_step(step, motion);
        let (place, speed, yaw) = (motion.position(), motion.speed_mps(), motion.yaw_rad());
        let remaining = motion.remaining_m();
        motion.step(DT_S);
        assert!((motion.speed_mps() - speed).abs() <= limits.acceleration_mps2 * DT_S + 1.0e-9, "speed jumps");
        assert!(wrap_angle(motion.yaw_rad() - yaw).abs() <= limits.yaw_rate_rad_s * DT_S + 1.0e-9, "yaw jumps");
        assert!((0.0..=limits.speed_mps + 1.0e-9).contains(&motion.speed_mps()));
        let mean = 0.5 * (speed + motion.speed_mps());
        assert!(motion.position().distance(place) <= mean * DT_S + 1.0e-6, "the place runs ahead of the speed");
        assert!(motion.remaining_m() <= remaining, "it flies back");
        assert!(mesh.contains(motion.position()), "{:?} is off the mesh", motion.position());
    }
    panic!("does not arrive: {} m remain", motion.remaining_m());
}

fn check_flight(mesh: &NavMesh, start: Vec2, goal: Vec2, limits: Limits, yaw_rad: f64) -> Result<(), TestCaseError> {
    let Ok(path) = mesh.path(start, goal) else { return Ok(()) };
    let rail = Rail::new(mesh, &path, &limits).expect("a path is flyable");
    prop_assert!(rail.points()[0].distance(start) < 1.0e-5 && rail.sample(rail.length_m()).0.distance(goal) < 1.0e-5);
    let steps = (rail.length_m() / 0.1) as usize;
    for i in 0..=steps {
        let s_m = i as f64 * 0.1;
        prop_assert!(mesh.contains(rail.sample(s_m).0));
        let (here, ahead) = (rail.speed_limit(s_m), rail.speed_limit(s_m + 0.1));
        prop_assert!(here * here <= ahead * ahead + 2.0 * limits.acceleration_mps2 * 0.1 + 1.0e-9);
    }
    prop_assert_eq!(rail.speed_limit(rail.length_m()), 0.0);
    let mut follower = Follower::new(rail, yaw_rad);
    fly(mesh, &mut follower, limits, |_, _| ());
    prop_assert_eq!((follower.speed_mps(), follower.remaining_m()), (0.0, 0.0));
    prop_assert!(follower.position().distance(goal) < 1.0e-5);
    Ok(())
}

fn any_limits() -> impl Strategy<Value = Limits> {
    prop_oneof![
        Just(AGENT),
        Just(Limits { speed_mps: 10.0, ..AGENT }),
        (0.5..15.0, 1.0..10.0, 0.3..3.0).prop_map(|(speed_mps, acceleration_mps2, yaw_rate_rad_s)| Limits {
            speed_mps,
            acceleration_mps2,
            yaw_rate_rad_s,
            ..AGENT
        }),
    ]
}

proptest! {
    #![proptest_config(config(64))]

    #[test]
    fn flights_over_corridors_keep_the_limits(
        scene in any_corridors(), a in any_shares(), b in any_shares(), limits in any_limits(), yaw_rad in -3.0..3.0,
    ) {
        let mesh = scene.bake();
        check_flight(&mesh, point_of(&mesh, a), point_of(&mesh, b), limits, yaw_rad)?;
    }

    #[test]
    fn flights_over_boards_keep_the_limits(
        open in any_board(), a in any_shares(), b in any_shares(), limits in any_limits(), yaw_rad in -3.0..3.0,
    ) {
        let mesh = square_mesh(8, 7.0, Vec2::new(3.0, 4.0), &open);
        check_flight(&mesh, point_of(&mesh, a), point_of(&mesh, b), limits, yaw_rad)?;
    }

    #[test]
    fn braking_anywhere_comes_to_rest_and_the_flight_still_ends(
        open in any_board(), a in any_shares(), b in any_shares(), at in 0_usize..200,
    ) {
        let mesh = square_mesh(8, 7.0, Vec2::new(3.0, 4.0), &open);
        let limits = AGENT;
        if let Ok(path) = mesh.path(point_of(&mesh, a), point_of(&mesh, b)) {
            let mut follower = Follower::new(Rail::new(&mesh, &path, &limits).expect("flyable"), 1.0);
            fly(&mesh, &mut follower, limits, |step, motion| {
                if step == at {
                    motion.brake();
                }
                if step == at + 20 {
                    assert_eq!(motion.speed_mps(), 0.0);
                    motion.resume();
                }
            });
        }
    }

    #[test]
    fn agents_that_do_not_give_way_are_avoided(
        from_yaw in 0.0..std::f64::consts::TAU, speed in 0.5..4.0_f64, miss in -3.0..3.0_f64, ahead_s in 3.0..8.0_f64,
    ) {
        let mesh = square_mesh(1, 200.0, Vec2::new(-100.0, -100.0), &[true]);
        let (own_m, other_m) = (0.5, 1.0);
        // It would be at the UAV's place after `ahead_s`, give or take `miss` metres.
        let along = Vec2::from_yaw(from_yaw);
        let meeting = Vec2::new(-20.0 + 5.0 * ahead_s, miss);
        let position = meeting - along * (speed * ahead_s);
        let mut other = Neighbour { position, velocity_mps: along * speed, radius_m: other_m };
        prop_assume!(other.position.distance(Vec2::new(-20.0, 0.0)) > 8.0);
        let closest = encounter(&mesh, Vec2::new(-20.0, 0.0), Vec2::new(60.0, 0.0), own_m, &mut [&mut other]);
        prop_assert!(closest >= own_m + other_m - 0.02, "{closest}");
    }
}

/// Flies from start to goal past agents that keep their course; the least distance from any of them.
fn encounter(mesh: &NavMesh, start: Vec2, goal: Vec2, radius_m: f64, others: &mut [&mut Neighbour]) -> f64 {
    let limits = AGENT;
    let avoider = Avoider { radius_m, limits };
    let (mut place, mut velocity) = (start, Vec2::ZERO);
    let mut closest = f64::INFINITY;
    for _ in 0..2000 {
        if place.distance(goal) < 1.0 {
            return closest;
        }
        let preferred = (goal - place).normalized() * limits.speed_mps;
        let neighbours: Vec<Neighbour> = others.iter().map(|other| **other).collect();
        let before = place;
        (place, velocity) = avoider.step(mesh, place, velocity, preferred, &neighbours, DT_S);
        assert!(mesh.contains(place), "{place:?} is off the mesh");
        assert!(before.distance(place) <= limits.speed_mps * DT_S + 1.0e-6);
        for other in others.iter_mut() {
            other.position = other.position + other.velocity_mps * DT_S;
            closest = closest.min(place.distance(other.position));
        }
    }
    panic!("no progress: still at {place:?}");
}

#[test]
fn a_head_on_encounter_in_a_corridor_stays_on_the_mesh() {
    let mesh = square_mesh(20, 8.0, Vec2::ZERO, &[true; 20]);
    let mut other = Neighbour { position: Vec2::new(90.0, 3.5), velocity_mps: Vec2::new(-3.0, 0.0), radius_m: 1.0 };
    let closest = encounter(&mesh, Vec2::new(5.0, 3.5), Vec2::new(150.0, 4.0), 0.5, &mut [&mut other]);
    assert!(closest >= 1.48, "{closest}");
    let mut waits = Neighbour { position: Vec2::new(60.0, 4.0), velocity_mps: Vec2::ZERO, radius_m: 1.5 };
    let closest = encounter(&mesh, Vec2::new(5.0, 4.0), Vec2::new(150.0, 4.0), 0.5, &mut [&mut waits]);
    assert!(closest >= 1.98, "{closest}");
}

#[test]
fn a_flight_past_a_corner_is_round_where_there_is_room() {
    let mesh = square_mesh(3, 20.0, Vec2::ZERO, &[true, true, true, true, false, false, true, false, false]);
    let path = mesh.path(Vec2::new(50.0, 10.0), Vec2::new(10.0, 50.0)).expect("reachable");
    assert_eq!(path.len(), 3);
    let rail = Rail::new(&mesh, &path, &AGENT).expect("flyable");
    assert_eq!(rail.stops_m().count(), 1, "no stop but the end");
    let straight_m: f64 = path.windows(2).map(|leg| leg[0].distance(leg[1])).sum();
    assert!(rail.length_m() < straight_m * 1.05, "{} against {straight_m}", rail.length_m());
    let slowest =
        (0..50).map(|i| rail.speed_limit(5.0 + f64::from(i) * (rail.length_m() - 10.0) / 50.0)).fold(9.0, f64::min);
    assert!(slowest > 4.9, "it slows down to {slowest} m/s");
}

#[test]
fn a_straight_flight_takes_the_time_of_a_trapezoid() {
    let mesh = square_mesh(1, 100.0, Vec2::ZERO, &[true]);
    let limits = AGENT;
    let rail = Rail::new(&mesh, &[Vec2::new(10.0, 50.0), Vec2::new(90.0, 50.0)], &limits).expect("flyable");
    let took_s = fly(&mesh, &mut Follower::new(rail, 0.0), limits, |_, _| ());
    assert!((took_s - (80.0 / 5.0 + 5.0 / 8.0)).abs() <= 2.0 * DT_S + 1.0e-9, "{took_s}");
    let (from, to) = (Vec2::new(10.0, 50.0), Vec2::new(10.0, 53.0));
    let mut strafe = Strafe::new(&mesh, from, to, 1.0, &limits).expect("inside");
    let took_s = fly(&mesh, &mut strafe, limits, |_, _| ());
    assert!((took_s - 2.0 * (3.0_f64 / 8.0).sqrt()).abs() <= 2.0 * DT_S, "{took_s}");
    assert_eq!((strafe.position(), strafe.yaw_rad(), strafe.speed_mps()), (to, 1.0, 0.0));
    let mut turn = TurnTo::new(from, 3.0, -3.0, &limits);
    let took_s = fly(&mesh, &mut turn, limits, |_, _| ());
    assert!(took_s < 0.5 && turn.yaw_rad() == -3.0);
}

#[test]
fn out_and_back_stops_and_turns_round() {
    let mesh = square_mesh(1, 100.0, Vec2::ZERO, &[true]);
    let limits = AGENT;
    let line = [(10.0, 50.0), (60.0, 50.0), (60.0, 50.0), (10.0, 50.0)].map(|(x, y)| Vec2::new(x, y));
    let rail = Rail::new(&mesh, &line, &limits).expect("flyable");
    assert_eq!(rail.stops_m().collect::<Vec<f64>>(), [50.0, 100.0]);
    let mut turned = false;
    fly(&mesh, &mut Follower::new(rail, 0.0), limits, |_, motion| turned |= motion.turning());
    assert!(turned);
}

/// Passes four metres apart: the fillets at the ends must leave the passes themselves as they were planned.
#[test]
fn inspection_passes_stay_on_their_line() {
    let mesh = square_mesh(1, 100.0, Vec2::ZERO, &[true]);
    let line = [(10.0, 50.0), (80.0, 50.0), (80.0, 54.0), (10.0, 54.0)].map(|(x, y)| Vec2::new(x, y));
    let rail = Rail::new(&mesh, &line, &AGENT).expect("flyable");
    for point in rail.points() {
        assert!(point.x > 70.0 || point.y == 50.0 || (point.y - 54.0).abs() < 1.0e-9, "{point:?}");
    }
}

#[test]
fn degenerate_flights_are_over_at_once_and_bad_ones_are_named() {
    let mesh = square_mesh(1, 10.0, Vec2::ZERO, &[true]);
    let (here, limits) = (Vec2::new(5.0, 5.0), AGENT);
    let rail = Rail::new(&mesh, &[here, here], &limits).expect("no length is a length");
    assert_eq!((rail.length_m(), rail.sample(1.0).0, rail.speed_limit(0.0)), (0.0, here, 0.0));
    let mut follower = Follower::new(rail, 2.0);
    follower.step(DT_S);
    assert!(follower.arrived() && !follower.turning() && follower.yaw_rad() == 2.0);
    assert!(Strafe::new(&mesh, here, here, 0.0, &limits).expect("stays").arrived());
    assert!(matches!(Rail::new(&mesh, &[], &limits), Err(NavMeshError::Empty)));
    let outside = Vec2::new(50.0, 5.0);
    assert!(matches!(Rail::new(&mesh, &[here, outside], &limits), Err(NavMeshError::LeavesMesh { .. })));
    assert!(matches!(Strafe::new(&mesh, here, outside, 0.0, &limits), Err(NavMeshError::GoalOutside { .. })));
    let still = Limits { speed_mps: 0.0, ..limits };
    assert!(matches!(Rail::new(&mesh, &[here], &still), Err(NavMeshError::BadConfig { .. })));
}

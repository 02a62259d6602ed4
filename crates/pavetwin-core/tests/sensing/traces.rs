//! The recorded traffic: interpolation, gaps, and the agents near a place.

use crate::scenes::{CAR, WALKER, any_place};
use pavetwin_core::geometry::{Vec2, wrap_angle};
use pavetwin_core::sensing::{AgentPose, Body, TELEPORT_MPS, Trace, TraceColumns, TraceError};
use proptest::prelude::*;

/// `(agent, position, yaw)` of each step.
type Steps = Vec<Vec<(u32, Vec2, f64)>>;

fn columns(steps: &Steps, bodies: Vec<Body>) -> TraceColumns {
    let rows: Vec<_> = steps.iter().flatten().collect();
    let mut step_offsets = vec![0];
    for step in steps {
        step_offsets.push(step_offsets.last().unwrap() + step.len() as u32);
    }
    TraceColumns {
        step_s: 0.5,
        step_offsets,
        agent: rows.iter().map(|row| row.0).collect(),
        x_m: rows.iter().map(|row| row.1.x).collect(),
        y_m: rows.iter().map(|row| row.1.y).collect(),
        yaw_rad: rows.iter().map(|row| row.2 as f32).collect(),
        speed_mps: vec![3.0; rows.len()],
        bodies,
    }
}

fn trace(steps: &Steps) -> Trace {
    let count = steps.iter().flatten().map(|row| row.0 + 1).max().unwrap_or(0);
    let bodies = (0..count).map(|agent| if agent % 2 == 0 { CAR } else { WALKER }).collect();
    Trace::new(columns(steps, bodies)).expect("a trace")
}

/// Forty agents that come and go, move by up to 25 m a step (some of it a teleport) and turn freely.
fn any_steps() -> impl Strategy<Value = Steps> {
    let motion = (any_place(60.0), prop::collection::vec((any_place(18.0), -9.0..9.0, prop::bool::weighted(0.85)), 5));
    prop::collection::vec(motion, 40).prop_map(|agents| {
        (0..5)
            .map(|step| {
                let place = |start: &Vec2, moves: &Vec<(Vec2, f64, bool)>| {
                    moves[..step].iter().fold(*start, |at, (shift, _, _)| at + *shift)
                };
                let present = agents.iter().enumerate().filter(|(_, (_, moves))| moves[step].2);
                present.map(|(agent, (start, moves))| (agent as u32, place(start, moves), moves[step].1)).collect()
            })
            .collect()
    })
}

#[test]
fn halfway_between_two_steps_is_halfway() {
    let trace = trace(&vec![vec![(0, Vec2::new(0.0, 0.0), 3.0)], vec![(0, Vec2::new(4.0, 2.0), -3.0)]]);
    let pose = trace.pose(0, 0.25).unwrap().unwrap();
    assert_eq!((pose.position, pose.velocity), (Vec2::new(2.0, 1.0), Vec2::new(8.0, 4.0)));
    // From 3 rad to −3 rad the shorter way leads through π.
    assert!((pose.yaw_rad.abs() - std::f64::consts::PI).abs() < 1e-6);
}

#[test]
fn an_agent_that_leaves_stands_until_the_next_step_and_is_then_gone() {
    let there = Vec2::new(5.0, 0.0);
    let trace = trace(&vec![vec![(0, there, 0.0)], vec![], vec![(0, Vec2::new(6.0, 0.0), 0.0)]]);
    let at = |t_s: f64| trace.pose(0, t_s).unwrap().map(|pose| pose.position);
    assert_eq!(
        (at(0.0), at(0.49), at(0.5), at(0.99), at(1.0)),
        (Some(there), Some(there), None, None, Some(Vec2::new(6.0, 0.0)))
    );
    assert_eq!(trace.pose(0, 0.2).unwrap().unwrap().velocity, Vec2::new(3.0, 0.0));
}

#[test]
fn a_teleport_is_not_a_motion() {
    let far = TELEPORT_MPS * 0.5 + 0.1;
    let trace = trace(&vec![vec![(0, Vec2::ZERO, 0.0)], vec![(0, Vec2::new(far, 0.0), 0.0)]]);
    assert_eq!(trace.pose(0, 0.49).unwrap().unwrap().position, Vec2::ZERO);
    assert_eq!(trace.pose(0, 0.5).unwrap().unwrap().position, Vec2::new(far, 0.0));
    assert_eq!(trace.max_speed_mps(), 3.0);
}

/// A row is filed in one hash cell, but the agent crosses into it from another: it is found at both ends of its way.
#[test]
fn an_agent_is_found_on_either_side_of_a_cell_border_that_it_crosses() {
    let trace = trace(&vec![vec![(0, Vec2::new(31.0, 5.0), 0.0)], vec![(0, Vec2::new(49.0, 5.0), 0.0)]]);
    let count = |x_m: f64, t_s: f64| {
        let mut found = 0;
        trace.agents_near(Vec2::new(x_m, 5.0), 1.0, t_s, &mut |_| found += 1).unwrap();
        found
    };
    assert_eq!(
        (count(28.0, 0.0), count(28.0, 0.2), count(40.0, 0.25), count(51.0, 0.5), count(47.0, 0.0)),
        (1, 0, 1, 1, 0)
    );
}

#[test]
fn times_outside_the_recording_are_refused() {
    let trace = trace(&vec![vec![], vec![], vec![]]);
    assert_eq!((trace.duration_s(), trace.step_count(), trace.row_count()), (1.0, 3, 0));
    assert!(trace.agents_at(1.0).is_ok_and(|mut agents| agents.next().is_none()));
    assert_eq!(trace.pose(0, 1.0001), Err(TraceError::PastEnd { t_s: 1.0001, duration_s: 1.0 }));
    assert!(matches!(trace.pose(0, -0.1), Err(TraceError::NotATime { .. })));
    assert!(matches!(trace.agents_near(Vec2::ZERO, 1.0, 9.0, &mut |_| ()), Err(TraceError::PastEnd { .. })));
}

proptest! {
    #[test]
    fn the_agents_near_are_those_of_a_walk_over_all(
        steps in any_steps(),
        centre in any_place(70.0),
        radius in 0.0..30.0,
        t_s in 0.0..=2.0,
    ) {
        let trace = trace(&steps);
        let mut near = Vec::new();
        trace.agents_near(centre, radius, t_s, &mut |pose| near.push(pose)).unwrap();
        near.sort_by_key(|pose| pose.agent);
        let is_near = |pose: &AgentPose| pose.position.distance(centre) <= radius + pose.body.half_diagonal_m();
        let all: Vec<_> = trace.agents_at(t_s).unwrap().filter(is_near).collect();
        prop_assert_eq!(near, all);
    }

    #[test]
    fn poses_pass_through_the_rows_and_never_overshoot(steps in any_steps(), share in 0.0..1.0f64) {
        let trace = trace(&steps);
        for (k, rows) in steps.iter().enumerate() {
            let t_s = 0.5 * k as f64;
            prop_assert_eq!(trace.agents_at(t_s).unwrap().count(), rows.len());
            for &(agent, at, yaw) in rows {
                let pose = trace.pose(agent, t_s).unwrap().unwrap();
                prop_assert_eq!(pose.position, at);
                prop_assert!(wrap_angle(pose.yaw_rad - yaw).abs() < 1e-5);
                let next = steps.get(k + 1).and_then(|step| step.iter().find(|row| row.0 == agent));
                let Some(&(_, to, to_yaw)) = next else { continue };
                let between = trace.pose(agent, t_s + 0.5 * share).unwrap().unwrap();
                if to.distance(at) > TELEPORT_MPS * 0.5 {
                    prop_assert_eq!(between.position, at);
                } else {
                    prop_assert!(between.position.distance(at.lerp(to, share)) < 1e-9);
                    let turn = wrap_angle(to_yaw - yaw).abs();
                    prop_assert!(wrap_angle(between.yaw_rad - yaw).abs() <= turn + 1e-5);
                    prop_assert!((between.velocity - (to - at) * 2.0).length() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn a_trace_that_goes_on_is_the_one_made_at_once(steps in any_steps(), others in any_steps(), kept in 1usize..=5) {
        let whole = trace(&steps);
        let all = columns(&steps, whole.bodies().to_vec());
        for known in [trace(&steps[..kept].to_vec()), trace(&others)] {
            // Another recording with the same numbers of rows is the caller's mistake; it is not what is tried here.
            let is_beginning = known.is_prefix_of(&whole);
            let same_layout = known.row_count() == whole.row_count();
            prop_assume!(is_beginning || !same_layout);
            let longer = Trace::beginning_with(&known, all.clone()).unwrap();
            prop_assert_eq!(format!("{longer:?}"), format!("{whole:?}"));
        }
    }

    #[test]
    fn a_shortened_recording_is_a_prefix(steps in any_steps(), kept in 1usize..5) {
        let whole = trace(&steps);
        let short = Trace::new(columns(&steps[..kept].to_vec(), whole.bodies().to_vec())).unwrap();
        prop_assert!(short.is_prefix_of(&whole) && whole.is_prefix_of(&whole));
        prop_assert_eq!(whole.is_prefix_of(&short), kept == 5);
        let mut other = steps.clone();
        if let Some(row) = other[0].first_mut() {
            row.1.x += 0.01;
            prop_assert!(!short.is_prefix_of(&trace(&other)));
        }
    }
}

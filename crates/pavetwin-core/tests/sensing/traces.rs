//! The recorded traffic: interpolation, gaps, and the agents near a place.

use crate::scenes::{CAR, WALKER, any_place};
use pavetwin_core::geometry::{Vec2, wrap_angle};
use pavetwin_core::sensing::{
    AgentPose, Body, HELD_ROWS, KeyFrames, Stretch, TELEPORT_MPS, Trace, TraceColumns, TraceError, TraceParts,
};
use proptest::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

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

fn trace_with(steps: &[Vec<(u32, Vec2, f64)>], bodies: &[Body]) -> Trace {
    Trace::new(columns(&steps.to_vec(), bodies.to_vec())).expect("a trace")
}

/// Eight steps of which each agent stands still in some, so that not every one needs a key frame.
fn steps_with_stops() -> impl Strategy<Value = Steps> {
    (any_steps(), any_steps()).prop_map(|(before, after)| {
        let order = [(&before, 0), (&before, 0), (&before, 0), (&before, 1), (&before, 1), (&after, 2), (&after, 2)];
        let single = |metres: f64| f64::from(metres as f32);
        let rounded =
            |&(agent, at, yaw): &(u32, Vec2, f64)| (agent, Vec2::new(single(at.x), single(at.y)), single(yaw));
        order.into_iter().chain([(&after, 3)]).map(|(half, step)| half[step].iter().map(rounded).collect()).collect()
    })
}

/// The steps from `first` up to `end`, in parts of `length` steps of the whole, without the poses that follow from
/// others. Counts how often a part is read.
fn parts(steps: &Steps, length: usize, first: usize, end: usize, read: Arc<AtomicUsize>) -> TraceParts {
    let whole = trace(steps);
    let (bodies, max_speed_mps) = (whole.bodies().to_vec(), whole.max_speed_mps());
    let (steps, agents) = (steps.clone(), bodies.len());
    let starts: Vec<usize> = (0..steps.len() - 1).step_by(length).collect();
    let ends: Vec<usize> = starts[1..].iter().copied().chain([steps.len() - 1]).collect();
    let bounds = starts.clone();
    let reader = move |part: usize| {
        read.fetch_add(1, Ordering::Relaxed);
        let (mut columns, mut is_last) = ((vec![], vec![], vec![], vec![], vec![]), vec![]);
        for agent in 0..agents as u32 {
            let pose = |step: usize| {
                let inside = (bounds[part]..=ends[part]).contains(&step);
                steps.get(step).filter(|_| inside)?.iter().find(|row| row.0 == agent).map(|row| (row.1, row.2))
            };
            for step in bounds[part]..=ends[part] {
                let Some((at, yaw)) = pose(step) else { continue };
                let before = step.checked_sub(1).and_then(pose);
                if before == pose(step) && pose(step + 1) == before {
                    continue;
                }
                columns.0.push(agent);
                columns.1.push(step as u32);
                columns.2.push(at.x as f32);
                columns.3.push(at.y as f32);
                columns.4.push(yaw as f32);
                is_last.push(pose(step + 1).is_none());
            }
        }
        let keys = KeyFrames {
            first_step: bounds[part] as u32,
            last_step: ends[part] as u32,
            agent: &columns.0,
            step: &columns.1,
            x_m: &columns.2,
            y_m: &columns.3,
            yaw_rad: &columns.4,
            speed_mps: &vec![3.0; is_last.len()],
            is_last: &is_last,
        };
        Stretch::of_key_frames(&keys, agents, 0.5)
    };
    let (first_step, step_count) = (first, end - first);
    TraceParts {
        step_s: 0.5,
        first_step,
        step_count,
        starts,
        read: Box::new(reader),
        bodies,
        max_speed_mps,
        held_rows: HELD_ROWS,
    }
}

#[test]
fn a_part_is_read_when_the_clock_reaches_it_and_kept_by_what_goes_on() {
    let steps: Steps = (0..9).map(|step| vec![(0, Vec2::new(f64::from(step), 0.0), 0.0)]).collect();
    let read = Arc::new(AtomicUsize::new(0));
    let count = || read.load(Ordering::Relaxed);
    let short = Trace::of_parts(parts(&steps[..6].to_vec(), 2, 0, 6, read.clone())).unwrap();
    assert_eq!(count(), 0);
    let x = |trace: &Trace, t_s: f64| trace.pose(0, t_s).unwrap().unwrap().position.x;
    assert_eq!((x(&short, 0.25), x(&short, 0.75), count()), (0.5, 1.5, 1));
    assert_eq!((x(&short, 1.0), count()), (2.0, 2));
    let long = Trace::going_on(&short, parts(&steps, 2, 0, 9, read.clone())).unwrap();
    assert!(short.is_prefix_of(&long).unwrap());
    assert_eq!((x(&long, 0.5), x(&long, 1.25), x(&long, 3.75), count()), (1.0, 2.5, 7.5, 3));
    assert_eq!(x(&short, 0.5), 1.0);
    assert_eq!(count(), 3);
}

#[test]
fn what_is_not_held_is_read_again() {
    let steps: Steps = (0..9).map(|step| vec![(0, Vec2::new(f64::from(step), 0.0), 0.0)]).collect();
    let x = |trace: &Trace, t_s: f64| trace.pose(0, t_s).unwrap().unwrap().position.x;
    for (held_rows, reads) in [(HELD_ROWS, 2), (0, 3)] {
        let read = Arc::new(AtomicUsize::new(0));
        let trace = Trace::of_parts(TraceParts { held_rows, ..parts(&steps, 4, 0, 9, read.clone()) }).unwrap();
        let times = [0.25, 0.75, 2.25, 2.75, 0.25].map(|t_s| x(&trace, t_s));
        assert_eq!((times, read.load(Ordering::Relaxed)), ([0.5, 1.5, 4.5, 5.5, 0.5], reads));
    }
}

#[test]
fn a_part_that_cannot_be_read_is_said() {
    let steps: Steps = vec![vec![(0, Vec2::ZERO, 0.0)]; 5];
    let reason = "the file is gone".to_string();
    let gone = TraceError::Unreadable { reason };
    let told = gone.clone();
    let mut parts = parts(&steps, 2, 0, 5, Arc::default());
    parts.read = Box::new(move |_| Err(told.clone()));
    assert_eq!(Trace::of_parts(parts).unwrap().pose(0, 1.0), Err(gone));
}

#[test]
fn key_frames_that_are_none_are_refused() {
    let made = |agent: &[u32], step: &[u32], x_m: f32| {
        let (place, is_last) = (vec![x_m; agent.len()], vec![false; agent.len()]);
        let keys = KeyFrames {
            first_step: 4,
            last_step: 8,
            agent,
            step,
            x_m: &place,
            y_m: &place,
            yaw_rad: &place,
            speed_mps: &place,
            is_last: &is_last,
        };
        Stretch::of_key_frames(&keys, 2, 0.5).map(|_| ())
    };
    assert_eq!(made(&[0, 0, 1], &[4, 8, 4], 1.0), Ok(()));
    assert_eq!(made(&[0, 0], &[5, 5], 1.0), Err(TraceError::Unsorted { row: 1 }));
    assert_eq!(made(&[1, 0], &[4, 5], 1.0), Err(TraceError::Unsorted { row: 1 }));
    assert_eq!(made(&[0, 0], &[4, 9], 1.0), Err(TraceError::Unsorted { row: 1 }));
    assert_eq!(made(&[0, 2], &[4, 5], 1.0), Err(TraceError::UnknownAgent { row: 1, agent: 2, bodies: 2 }));
    assert_eq!(made(&[0], &[4], f32::NAN), Err(TraceError::Value { row: 0 }));
    assert_eq!(made(&[0], &[], 1.0), Err(TraceError::Length { column: "step", found: 0, rows: 1 }));
}

#[test]
fn between_two_key_frames_an_agent_goes_evenly() {
    let keys = KeyFrames {
        first_step: 0,
        last_step: 4,
        agent: &[0, 0],
        step: &[0, 4],
        x_m: &[0.0, 8.0],
        y_m: &[0.0, 0.0],
        yaw_rad: &[3.0, -3.0],
        speed_mps: &[0.0, 4.0],
        is_last: &[false, true],
    };
    let stretch = Stretch::of_key_frames(&keys, 1, 0.5).unwrap();
    let read = Box::new(move |_| Ok(stretch.clone()));
    let (bodies, starts) = (vec![CAR], vec![0]);
    let parts = TraceParts {
        step_s: 0.5,
        first_step: 0,
        step_count: 5,
        starts,
        read,
        bodies,
        max_speed_mps: 4.0,
        held_rows: HELD_ROWS,
    };
    let pose = Trace::of_parts(parts).unwrap().pose(0, 1.25).unwrap().unwrap();
    assert_eq!((pose.position, pose.velocity), (Vec2::new(5.0, 0.0), Vec2::new(4.0, 0.0)));
    assert!(wrap_angle(pose.yaw_rad - 3.0 - 0.625 * (std::f64::consts::TAU - 6.0)).abs() < 1e-6);
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
    assert_eq!((trace.duration_s(), trace.step_count()), (1.0, 3));
    assert!(trace.agents_at(1.0).is_ok_and(|agents| agents.is_empty()));
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
        let all: Vec<_> = trace.agents_at(t_s).unwrap().into_iter().filter(is_near).collect();
        prop_assert_eq!(near, all);
    }

    #[test]
    fn poses_pass_through_the_rows_and_never_overshoot(steps in any_steps(), share in 0.0..1.0f64) {
        let trace = trace(&steps);
        for (k, rows) in steps.iter().enumerate() {
            let t_s = 0.5 * k as f64;
            prop_assert_eq!(trace.agents_at(t_s).unwrap().len(), rows.len());
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
    fn a_trace_in_parts_is_the_one_in_memory(
        steps in steps_with_stops(),
        length in 1usize..6,
        first in 0usize..4,
        end in 5usize..=8,
        centre in any_place(70.0),
        share in 0.0..1.0f64,
    ) {
        let whole = trace(&steps);
        let window = trace_with(&steps[first..end], whole.bodies());
        let parts = Trace::of_parts(parts(&steps, length, first, end, Arc::default())).unwrap();
        prop_assert_eq!(parts.duration_s(), window.duration_s());
        prop_assert!(parts.is_prefix_of(&window).unwrap() && window.is_prefix_of(&parts).unwrap());
        for t_s in (0..end - first).flat_map(|step| [0.5 * step as f64, (0.5 * (step as f64 + share)).min(window.duration_s())]) {
            prop_assert_eq!(parts.agents_at(t_s).unwrap(), window.agents_at(t_s).unwrap());
            let near = |trace: &Trace| {
                let mut near = Vec::new();
                trace.agents_near(centre, 20.0, t_s, &mut |pose| near.push(pose)).unwrap();
                near.sort_by_key(|pose| pose.agent);
                near
            };
            prop_assert_eq!(near(&parts), near(&window));
        }
    }

    #[test]
    fn a_shortened_recording_is_a_prefix(steps in any_steps(), kept in 1usize..5) {
        let whole = trace(&steps);
        let short = Trace::new(columns(&steps[..kept].to_vec(), whole.bodies().to_vec())).unwrap();
        prop_assert!(short.is_prefix_of(&whole).unwrap() && whole.is_prefix_of(&whole).unwrap());
        prop_assert_eq!(whole.is_prefix_of(&short).unwrap(), kept == 5);
        let mut other = steps.clone();
        if let Some(row) = other[0].first_mut() {
            row.1.x += 0.01;
            prop_assert!(!short.is_prefix_of(&trace(&other)).unwrap());
        }
    }
}

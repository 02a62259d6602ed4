//! The kernel and the brute force agree on every cell of random scenes.

use crate::brute::{agent_hides, in_window, solid_hides};
use crate::scenes::*;
use crate::support::{DEFAULT, camera};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{CellSet, Observer, Predictor, Scene, Solids};
use proptest::prelude::*;
use std::collections::HashSet;

/// Cells closer than this to a rim may be judged either way. Metres.
const RIM_M: f64 = 1.0e-5;

proptest! {
    #[test]
    fn every_cell_is_judged_like_the_brute_force(
        agents in any_agents(),
        prisms in prop::collection::vec(any_prism(), 0..5),
        parked in prop::collection::vec(any_parked(), 0..6),
        from in any_viewpoint(),
        rule in any_rule(),
    ) {
        let (grid, trace, camera) = (street(), standing(&agents), camera(rule));
        let solids = Solids::new(prisms.clone()).with_parked(parked.clone());
        let (observer, seen) = look(&grid, &solids, &trace, &camera, &from);
        let candidates: HashSet<_> = observer.candidates().cells().collect();
        let visible: HashSet<_> = observer.visible().cells().collect();
        let hidden: HashSet<_> = observer.hidden().cells().collect();
        let window = camera.window(from.altitude_m);
        let poses = poses(&trace);
        let (mut least_behind_parked, mut most_behind_parked) = (0, 0);
        for row in 0..grid.shape().rows {
            for column in 0..grid.shape().columns() {
                let (cell, centre) = ((column, row), grid.centre(column, row));
                let is_unobstructed = |slack: f64| grid.contains(column, row)
                    && in_window(&from, window, centre, -slack)
                    && !prisms.iter().any(|prism| solid_hides(&from, centre, prism, slack));
                let is_candidate = |slack: f64| is_unobstructed(slack)
                    && !parked.iter().any(|vehicle| solid_hides(&from, centre, vehicle, slack));
                least_behind_parked += u32::from(is_unobstructed(RIM_M) && !is_candidate(-RIM_M));
                most_behind_parked += u32::from(is_unobstructed(-RIM_M) && !is_candidate(RIM_M));
                let is_visible = |slack: f64| is_candidate(slack)
                    && !poses.iter().any(|pose| agent_hides(&from, centre, pose, slack));
                if is_candidate(RIM_M) == is_candidate(-RIM_M) {
                    let expected = is_candidate(0.0);
                    prop_assert_eq!(candidates.contains(&cell), expected, "candidate {:?} at {:?}", cell, centre);
                }
                if is_visible(RIM_M) == is_visible(-RIM_M) {
                    prop_assert_eq!(visible.contains(&cell), is_visible(0.0), "visible {:?} at {:?}", cell, centre);
                }
            }
        }
        prop_assert!((least_behind_parked..=most_behind_parked).contains(&seen.behind_parked));
        prop_assert!(visible.is_subset(&candidates));
        prop_assert_eq!(&hidden, &candidates.difference(&visible).copied().collect());
        prop_assert_eq!((seen.candidates as usize, seen.visible as usize), (candidates.len(), visible.len()));
        prop_assert_eq!(seen.has_candidates, !candidates.is_empty());
        let share = if candidates.is_empty() { 0.0 } else { visible.len() as f64 / candidates.len() as f64 };
        prop_assert_eq!(seen.share, share);
        match seen.hidden_centroid {
            None => prop_assert!(hidden.is_empty()),
            Some(centroid) => {
                let sum = hidden.iter().fold(Vec2::ZERO, |sum, &(column, row)| sum + grid.centre(column, row));
                prop_assert!(centroid.distance(sum * (1.0 / hidden.len() as f64)) < 1e-9);
            }
        }
        let mut set = CellSet::empty(&grid);
        set.insert(observer.visible()).unwrap();
        prop_assert_eq!(set.count(), visible.len());
        prop_assert!(visible.iter().all(|&(column, row)| set.contains(column, row)));
    }

    #[test]
    fn the_visible_fraction_of_points_is_the_brute_forces(
        agents in any_agents(),
        prisms in prop::collection::vec(any_prism(), 0..5),
        from in any_viewpoint(),
        points in prop::collection::vec(any_place(30.0), 0..40),
    ) {
        let trace = standing(&agents);
        let solids = Solids::new(prisms.clone());
        let share = Observer::new().visible_fraction(&solids, &trace, &from, 0.0, &points).unwrap();
        let poses = poses(&trace);
        let clear = |slack: f64| {
            let is_clear = |point: &&Vec2| !poses.iter().any(|pose| agent_hides(&from, **point, pose, slack))
                && !prisms.iter().any(|prism| solid_hides(&from, **point, prism, slack));
            points.iter().filter(is_clear).count() as f64 / points.len() as f64
        };
        match share {
            None => prop_assert!(points.is_empty()),
            Some(share) => prop_assert!((clear(RIM_M)..=clear(-RIM_M)).contains(&share)),
        }
    }

    /// Predicting is looking again: at traffic built again from the extrapolated poses.
    #[test]
    fn a_prediction_is_a_look_at_the_extrapolated_traffic(
        agents in any_agents(),
        prisms in prop::collection::vec(any_prism(), 0..3),
        from in any_viewpoint(),
        shift in any_place(3.0),
        horizon_s in 0.0..3.0,
    ) {
        let (grid, trace, camera) = (street(), standing(&agents), camera(DEFAULT));
        let solids = Solids::new(prisms);
        let (observer, _) = look(&grid, &solids, &trace, &camera, &from);
        let scene = Scene { grid: &grid, solids: &solids, trace: &trace };
        let mut there = from;
        there.position = from.position + shift;
        let mut predictor = Predictor::new();
        let shares = predictor.predict(&scene, &camera, observer.hidden(), &[from, there], 0.0, horizon_s).unwrap();
        let moved: Vec<Placed> = poses(&trace)
            .iter()
            .map(|pose| (pose.body, pose.extrapolated(horizon_s).position, pose.yaw_rad, 0.0))
            .collect();
        let hidden: HashSet<_> = observer.hidden().cells().collect();
        match shares {
            None => prop_assert!(hidden.is_empty()),
            Some(shares) => for (share, place) in shares.iter().zip([&from, &there]) {
                let (later, _) = look(&grid, &solids, &standing(&moved), &camera, place);
                let shown = later.visible().cells().filter(|cell| hidden.contains(cell)).count();
                // The rebuilt trace rounds yaws once more, which may flip a cell on a rim.
                prop_assert!((share * hidden.len() as f64 - shown as f64).abs() < 1.5);
            }
        }
    }
}

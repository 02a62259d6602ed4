//! What must hold of visibility whatever the scene.

use crate::scenes::*;
use crate::support::{DEFAULT, PAPER, camera};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{AgentPose, Body, BodyClass, Patch, Prism, Solids, SurfaceGrid, Viewpoint, Visibility};
use proptest::prelude::*;
use std::collections::HashSet;

fn cells(patch: &Patch) -> HashSet<(usize, usize)> {
    patch.cells().collect()
}

fn moved(agents: &[Placed], shift: Vec2) -> Vec<Placed> {
    agents.iter().map(|&(body, at, yaw, speed)| (body, at + shift, yaw, speed)).collect()
}

fn box_of(pose: &AgentPose) -> Prism {
    let ahead = Vec2::from_yaw(pose.yaw_rad);
    let (along, across) = (ahead * (0.5 * pose.body.length_m), ahead.left() * (0.5 * pose.body.width_m));
    let at = pose.position;
    let base = vec![at + along + across, at - along + across, at - along - across, at + along - across];
    Prism::new(base, pose.body.base_m, pose.body.height_m).unwrap()
}

proptest! {
    #[test]
    fn moving_everything_by_whole_cells_changes_nothing(
        agents in any_agents(),
        prism in any_prism(),
        from in any_viewpoint(),
        columns in -4000i32..4000,
        rows in -4000i32..4000,
    ) {
        let shift = Vec2::new(f64::from(columns) * 0.25, f64::from(rows) * 0.25);
        let outline = ring(&[(-30.0, -7.1), (30.2, -7.3), (30.1, 7.2), (-30.4, 7.6)]);
        let grid = SurfaceGrid::from_rings(std::slice::from_ref(&outline), 0.25).unwrap();
        let there: Vec<Vec2> = outline.iter().map(|&corner| corner + shift).collect();
        let grid_there = SurfaceGrid::from_rings(&[there], 0.25).unwrap();
        let prism_there = prism.base().iter().map(|&corner| corner + shift).collect();
        let solids_there = Solids::new([Prism::new(prism_there, prism.base_m(), prism.top_m()).unwrap()]);
        let view_there = Viewpoint { position: from.position + shift, ..from };
        let camera = camera(DEFAULT);
        let (_, here) = look(&grid, &Solids::new([prism]), &standing(&agents), &camera, &from);
        let (_, there) = look(&grid_there, &solids_there, &standing(&moved(&agents, shift)), &camera, &view_there);
        prop_assert_eq!((here.candidates, here.visible), (there.candidates, there.visible));
    }

    /// A quarter turn maps the lattice on itself.
    #[test]
    fn turning_everything_by_a_quarter_changes_nothing(agents in any_agents(), from in any_viewpoint()) {
        let outline = ring(&[(-30.0, -7.1), (30.2, -7.3), (30.1, 7.2), (-30.4, 7.6)]);
        let turned = outline.iter().map(|corner| corner.left()).collect();
        let grid = SurfaceGrid::from_rings(&[outline], 0.25).unwrap();
        let grid_turned = SurfaceGrid::from_rings(&[turned], 0.25).unwrap();
        let trace = standing(&agents);
        let quarter_rad = std::f64::consts::FRAC_PI_2;
        let agents_turned: Vec<Placed> = agents.iter().map(|a| (a.0, a.1.left(), a.2 + quarter_rad, a.3)).collect();
        let view_turned = Viewpoint { position: from.position.left(), yaw_rad: from.yaw_rad + quarter_rad, ..from };
        let (camera, solids) = (camera(PAPER), Solids::default());
        let (_, here) = look(&grid, &solids, &trace, &camera, &from);
        let (_, there) = look(&grid_turned, &solids, &standing(&agents_turned), &camera, &view_turned);
        // Yaws are single precision, so a cell on a rim may flip.
        prop_assert!(here.candidates.abs_diff(there.candidates) <= 1 && here.visible.abs_diff(there.visible) <= 2);
    }

    #[test]
    fn looking_backwards_shows_the_same(agents in any_agents(), from in any_viewpoint(), rule in any_rule()) {
        let back = Viewpoint { yaw_rad: from.yaw_rad + std::f64::consts::PI, ..from };
        let (grid, trace, camera, solids) = (street(), standing(&agents), camera(rule), Solids::default());
        let (_, forth) = look(&grid, &solids, &trace, &camera, &from);
        let (_, back) = look(&grid, &solids, &trace, &camera, &back);
        prop_assert_eq!((forth.candidates, forth.visible), (back.candidates, back.visible));
    }

    #[test]
    fn one_agent_more_never_shows_more(agents in any_agents(), one in any_agent(), from in any_viewpoint()) {
        let (grid, camera, solids) = (street(), camera(DEFAULT), Solids::default());
        let (before, _) = look(&grid, &solids, &standing(&agents), &camera, &from);
        let mut more = agents.clone();
        more.push(one);
        let (after, _) = look(&grid, &solids, &standing(&more), &camera, &from);
        prop_assert_eq!(before.candidates(), after.candidates());
        prop_assert!(cells(after.visible()).is_subset(&cells(before.visible())));
    }

    #[test]
    fn one_parked_vehicle_more_never_shows_more(
        agents in any_agents(),
        parked in prop::collection::vec(any_parked(), 0..5),
        one in any_parked(),
        from in any_viewpoint(),
    ) {
        let (grid, camera, trace) = (street(), camera(DEFAULT), standing(&agents));
        let more = parked.iter().cloned().chain([one]);
        let (before, seen_before) = look(&grid, &Solids::default().with_parked(parked.clone()), &trace, &camera, &from);
        let (after, seen_after) = look(&grid, &Solids::default().with_parked(more), &trace, &camera, &from);
        prop_assert!(cells(after.candidates()).is_subset(&cells(before.candidates())));
        prop_assert!(cells(after.visible()).is_subset(&cells(before.visible())));
        let all = |seen: Visibility| seen.candidates + seen.behind_parked;
        prop_assert_eq!(all(seen_after), all(seen_before));
    }

    /// What the moving hide and what the parked hide for good are the same cells where the same bodies stand.
    #[test]
    fn what_stands_in_traffic_and_what_is_parked_hide_the_same(agents in any_agents(), from in any_viewpoint()) {
        let vehicles: Vec<Placed> = agents.into_iter().filter(|agent| agent.0.class == BodyClass::Vehicle).collect();
        let (grid, camera, trace) = (street(), camera(DEFAULT), standing(&vehicles));
        let parked = Solids::default().with_parked(poses(&trace).iter().map(box_of));
        let (moving, _) = look(&grid, &Solids::default(), &trace, &camera, &from);
        let (standing, _) = look(&grid, &parked, &self::standing(&[]), &camera, &from);
        prop_assert_eq!(cells(moving.visible()), cells(standing.visible()));
    }

    #[test]
    fn a_taller_body_hides_what_the_lower_one_hid(agent in any_agent(), extra_m in 0.0..9.0, from in any_viewpoint()) {
        let (grid, camera, solids) = (street(), camera(DEFAULT), Solids::default());
        let mut taller = agent;
        taller.0.height_m += extra_m;
        let (low, _) = look(&grid, &solids, &standing(&[agent]), &camera, &from);
        let (high, _) = look(&grid, &solids, &standing(&[taller]), &camera, &from);
        prop_assert!(cells(low.hidden()).is_subset(&cells(high.hidden())));
    }

    #[test]
    fn agents_off_the_window_never_matter(agents in any_agents(), from in any_viewpoint(), rule in any_rule()) {
        let (grid, camera, solids) = (street(), camera(rule), Solids::default());
        let window = camera.window(from.altitude_m);
        let reach_m = |body: Body| window.half_diagonal_m() + body.half_diagonal_m();
        let is_off = |agent: &&Placed| agent.1.distance(from.position) > reach_m(agent.0);
        let outside: Vec<Placed> = agents.iter().filter(is_off).copied().collect();
        let (_, seen) = look(&grid, &solids, &standing(&outside), &camera, &from);
        prop_assert_eq!(seen.candidates, seen.visible);
    }

    #[test]
    fn a_used_observer_sees_like_a_new_one(
        looks in prop::collection::vec((any_agents(), any_viewpoint(), any_rule()), 1..6)
    ) {
        let grid = street();
        let mut used = pavetwin_core::sensing::Observer::new();
        for (agents, from, rule) in looks {
            let (trace, camera, solids) = (standing(&agents), camera(rule), Solids::default());
            let scene = pavetwin_core::sensing::Scene { grid: &grid, solids: &solids, trace: &trace };
            let again = used.observe(&scene, &camera, &from, 0.0).unwrap();
            let (fresh, first) = look(&grid, &solids, &trace, &camera, &from);
            prop_assert_eq!(again, first);
            prop_assert_eq!(used.visible(), fresh.visible());
            prop_assert_eq!(used.hidden(), fresh.hidden());
        }
    }
}

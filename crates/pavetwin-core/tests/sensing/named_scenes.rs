//! Tiny scenes whose answer is known.

use crate::scenes::*;
use crate::support::{DEFAULT, PAPER, camera};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{
    Body, Observer, PointShares, Predictor, Prism, Reach, Scene, SenseError, Solids, TraceError, Viewpoint,
};

#[test]
fn an_empty_street_is_wholly_visible() {
    let (_, seen) =
        look(&street(), &Solids::default(), &standing(&[]), &camera(DEFAULT), &viewpoint(-10.0, 0.0, 10.0, 0.0));
    // 0.5 · 11.547 m along the street, the whole 14 m across it.
    assert_eq!((seen.candidates, seen.visible, seen.share), (24 * 56, 24 * 56, 1.0));
    assert!(seen.has_candidates && seen.hidden_centroid.is_none());
}

#[test]
fn off_the_segment_there_are_no_candidates_and_no_share() {
    let (observer, seen) =
        look(&street(), &Solids::default(), &standing(&[]), &camera(DEFAULT), &viewpoint(500.0, 0.0, 10.0, 0.3));
    assert_eq!((seen.candidates, seen.visible, seen.share, seen.has_candidates), (0, 0, 0.0, false));
    assert!(observer.visible().is_empty());
}

#[test]
fn a_car_right_below_hides_its_own_enlarged_outline() {
    let car = (CAR, Vec2::new(-10.0, 0.0), 0.0, 0.0);
    let (_, seen) =
        look(&street(), &Solids::default(), &standing(&[car]), &camera(DEFAULT), &viewpoint(-10.0, 0.0, 15.0, 0.0));
    // Its roof at 1.5 m is thrown on the ground 15/13.5 times as large: 5.11 m × 2.0 m, 20 × 8 cell centres.
    assert_eq!(seen.candidates - seen.visible, 20 * 8);
    assert!(seen.hidden_centroid.unwrap().distance(Vec2::new(-10.0, 0.0)) < 1e-9);
}

#[test]
fn the_wall_of_a_truck_hides_the_far_side_only() {
    let truck = (TRUCK, Vec2::new(-10.0, 2.0), 0.0, 0.0);
    let (observer, _) =
        look(&street(), &Solids::default(), &standing(&[truck]), &camera(DEFAULT), &viewpoint(-10.0, -2.0, 6.0, 0.0));
    // Near side at y = 0.8; the roof's far edge, y = 3.2, is thrown from −2 to −2 + 5.2 · 6/2.6 = 10.
    let ys: Vec<f64> = observer.hidden().centres().map(|centre| centre.y).collect();
    assert!(ys.iter().all(|&y| y > 0.8) && !ys.is_empty());
    let window_edge = -2.0 + camera(DEFAULT).window(6.0).half_across_m;
    assert!(ys.iter().any(|&y| y > window_edge - 0.26));
}

#[test]
fn a_camera_below_the_roof_of_a_body_sees_nothing_behind_it() {
    let tower = Body { height_m: 40.0, ..TRUCK };
    for altitude_m in [2.0, 15.0, 39.999, 40.0] {
        let agents = [(tower, Vec2::new(-10.0, 2.0), 0.0, 0.0)];
        let (observer, seen) = look(
            &street(),
            &Solids::default(),
            &standing(&agents),
            &camera(DEFAULT),
            &viewpoint(-10.0, 0.0, altitude_m, 0.0),
        );
        assert!(seen.visible < seen.candidates);
        let is_behind = |centre: Vec2| centre.y > 0.8 && (centre.x + 10.0).abs() < 3.55 * (centre.y / 0.8).min(1.0);
        assert!(!observer.visible().centres().any(is_behind), "altitude {altitude_m}");
    }
}

#[test]
fn a_camera_inside_a_body_sees_nothing() {
    for class in [TRUCK, WALKER] {
        let agents = [(Body { height_m: 40.0, ..class }, Vec2::new(-10.0, 0.1), 0.4, 0.0)];
        let (_, seen) = look(
            &street(),
            &Solids::default(),
            &standing(&agents),
            &camera(DEFAULT),
            &viewpoint(-10.0, 0.0, 10.0, 0.0),
        );
        assert_eq!((seen.visible, seen.share, seen.has_candidates), (0, 0.0, true));
    }
}

#[test]
fn what_begins_above_the_camera_hides_nothing() {
    let bridge = Body { base_m: 10.0, height_m: 12.0, ..TRUCK };
    let crown = Prism::new(regular(Vec2::new(-10.0, 0.0), 3.0, 8, 0.0), 10.0, 14.0).unwrap();
    let agents = [(bridge, Vec2::new(-10.0, 0.0), 0.0, 0.0)];
    let (_, seen) =
        look(&street(), &Solids::new([crown]), &standing(&agents), &camera(DEFAULT), &viewpoint(-10.0, 0.0, 10.0, 0.0));
    assert_eq!((seen.candidates, seen.visible), (24 * 56, 24 * 56));
}

#[test]
fn a_crown_takes_candidates_away_and_leaves_the_share_alone() {
    let crown = Prism::new(regular(Vec2::new(-10.0, 5.0), 2.0, 12, 0.0), 3.0, 6.0).unwrap();
    let (observer, seen) =
        look(&street(), &Solids::new([crown]), &standing(&[]), &camera(DEFAULT), &viewpoint(-10.0, 0.0, 10.0, 0.0));
    assert!(seen.candidates < 24 * 56 && seen.share == 1.0 && seen.hidden_centroid.is_none());
    // The crown begins at 3 m: the ground below it, toward the camera, is seen: 3 · 10/7 = 4.29 is the first hidden.
    assert!(
        observer.visible().centres().any(|centre| centre.y > 3.5 && centre.y < 4.2 && (centre.x + 10.0).abs() < 0.2)
    );
    assert!(!observer.visible().centres().any(|centre| centre.y > 4.4 && (centre.x + 10.0).abs() < 0.2));
}

#[test]
fn a_defect_half_below_a_car_is_half_clear() {
    let trace = standing(&[(CAR, Vec2::new(0.0, 0.0), 0.0, 0.0)]);
    let points: Vec<Vec2> =
        (0..10).map(|i| Vec2::new(-0.45 + 0.1 * f64::from(i), if i % 2 == 0 { 0.0 } else { -3.0 })).collect();
    let share =
        Observer::new().visible_fraction(&Solids::default(), &trace, &viewpoint(0.0, 0.0, 15.0, 0.0), 0.0, &points);
    assert_eq!(share, Ok(Some(0.5)));
    let none = Observer::new().visible_fraction(&Solids::default(), &trace, &viewpoint(0.0, 0.0, 15.0, 0.0), 0.0, &[]);
    assert_eq!(none, Ok(None));
}

#[test]
fn what_hides_a_defect_is_told_by_kind() {
    let trace = standing(&[(CAR, Vec2::new(0.0, 0.0), 0.0, 0.0), (WALKER, Vec2::new(6.0, 0.0), 0.0, 0.0)]);
    let crown = Solids::new([Prism::new(regular(Vec2::new(0.5, 0.0), 0.3, 12, 0.0), 3.0, 6.0).unwrap()]);
    let points = [Vec2::new(0.0, 0.0), Vec2::new(0.5, 0.0), Vec2::new(6.0, 0.0), Vec2::new(0.0, -3.0)];
    let shares = Observer::new().point_shares(&crown, &trace, &viewpoint(0.0, 0.0, 15.0, 0.0), 0.0, &points);
    let moving = PointShares {
        visible: 0.25,
        behind_solids: 0.25,
        behind_parked: 0.0,
        behind_vehicles: 0.5,
        behind_pedestrians: 0.25,
    };
    assert_eq!(shares, Ok(Some(moving)));
    let parked = crown.with_parked([prism_of(CAR, Vec2::ZERO)]);
    let shares = Observer::new().point_shares(&parked, &standing(&[]), &viewpoint(0.0, 0.0, 15.0, 0.0), 0.0, &points);
    let stands =
        PointShares { visible: 0.5, behind_parked: 0.5, behind_vehicles: 0.0, behind_pedestrians: 0.0, ..moving };
    assert_eq!(shares, Ok(Some(stands)));
}

/// The box of a body that looks east.
fn prism_of(body: Body, centre: Vec2) -> Prism {
    let (x, y) = (0.5 * body.length_m, 0.5 * body.width_m);
    let corners = [(-x, -y), (x, -y), (x, y), (-x, y)].map(|(x, y)| centre + Vec2::new(x, y));
    Prism::new(corners.to_vec(), body.base_m, body.height_m).unwrap()
}

#[test]
fn a_parked_car_takes_candidates_away_where_a_moving_one_hides_them() {
    let from = viewpoint(-10.0, 0.0, 10.0, 0.0);
    let place = Vec2::new(-9.0, 2.0);
    let solids = Solids::default().with_parked([prism_of(CAR, place)]);
    let (parked, here) = look(&street(), &solids, &standing(&[]), &camera(DEFAULT), &from);
    let moving = standing(&[(CAR, place, 0.0, 0.0)]);
    let (_, there) = look(&street(), &Solids::default(), &moving, &camera(DEFAULT), &from);
    assert_eq!((here.share, here.hidden_centroid), (1.0, None));
    assert!(parked.hidden().is_empty());
    assert_eq!((here.visible, here.behind_parked), (there.visible, there.candidates - there.visible));
    assert_eq!(here.candidates + here.behind_parked, there.candidates);
    assert!((here.permanently_hidden() - (1.0 - there.share)).abs() < 1e-12);
    assert_eq!(there.permanently_hidden(), 0.0);
}

#[test]
fn a_window_full_of_a_parked_truck_has_no_candidates() {
    let vast = Body { length_m: 40.0, width_m: 20.0, ..TRUCK };
    let solids = Solids::default().with_parked([prism_of(vast, Vec2::new(-10.0, 0.0))]);
    let (_, seen) = look(&street(), &solids, &standing(&[]), &camera(DEFAULT), &viewpoint(-10.0, 0.0, 10.0, 0.0));
    assert!(!seen.has_candidates);
    assert_eq!((seen.candidates, seen.behind_parked, seen.permanently_hidden()), (0, 24 * 56, 1.0));
}

#[test]
fn what_a_tree_hides_is_not_hidden_by_the_car_below_it() {
    let crown = Prism::new(regular(Vec2::new(-10.0, 0.0), 4.0, 12, 0.0), 3.0, 6.0).unwrap();
    let solids = Solids::new([crown]).with_parked([prism_of(CAR, Vec2::new(-10.0, 0.0))]);
    let (_, seen) = look(&street(), &solids, &standing(&[]), &camera(DEFAULT), &viewpoint(-10.0, 0.0, 10.0, 0.0));
    assert_eq!((seen.behind_parked, seen.permanently_hidden()), (0, 0.0));
}

#[test]
fn from_several_places_only_what_all_miss_is_hidden_for_good() {
    let (grid, camera, car) = (street(), camera(DEFAULT), prism_of(CAR, Vec2::new(-10.0, 0.0)));
    let solids = Solids::default().with_parked([car]);
    let over = [viewpoint(-10.0, 0.0, 10.0, 0.0)];
    let past = |y: f64| [-13.0, -10.0, -7.0].map(|x| viewpoint(x, y, 10.0, 0.0));
    let from_both_sides = [past(2.5), past(-2.5)].concat();
    let hidden = |places: &[Viewpoint]| {
        Reach::of(&grid, &solids, &camera, places).unwrap().permanently_hidden().centres().collect::<Vec<_>>()
    };
    let (_, seen) = look(&grid, &solids, &standing(&[]), &camera, &over[0]);
    assert_eq!(hidden(&over).len(), seen.behind_parked as usize);
    let under = hidden(&from_both_sides);
    assert!(under.len() < hidden(&over).len());
    assert!(under.iter().all(|cell| (cell.x + 10.0).abs() < 2.3 && cell.y.abs() < 0.9), "under the car itself");
    assert!(matches!(Reach::of(&grid, &solids, &camera, &[viewpoint(0.0, 0.0, 0.0, 0.0)]), Err(SenseError::Camera(_))));
}

#[test]
fn micro_finds_the_side_from_which_the_ground_beside_a_truck_is_seen() {
    let (grid, trace, camera, solids) =
        (street(), standing(&[(TRUCK, Vec2::new(-10.0, 1.5), 0.0, 0.0)]), camera(DEFAULT), Solids::default());
    let from = viewpoint(-10.0, -2.0, 10.0, 0.0);
    let (observer, _) = look(&grid, &solids, &trace, &camera, &from);
    let scene = Scene { grid: &grid, solids: &solids, trace: &trace };
    let sides = [from, viewpoint(-10.0, -5.0, 10.0, 0.0), viewpoint(-10.0, 1.0, 10.0, 0.0)];
    let mut predictor = Predictor::new();
    let shares = predictor.predict(&scene, &camera, observer.hidden(), &sides, 0.0, 0.0).unwrap().unwrap();
    assert_eq!((shares[0], shares[1]), (0.0, 0.0));
    assert!(shares[2] > 0.3, "{shares:?}");
}

#[test]
fn a_car_that_drives_on_is_predicted_to_clear_the_ground() {
    let (grid, trace, camera, solids) =
        (street(), standing(&[(CAR, Vec2::new(-10.0, 0.0), 0.0, 10.0)]), camera(DEFAULT), Solids::default());
    let from = viewpoint(-10.0, 0.0, 10.0, 0.0);
    let (observer, _) = look(&grid, &solids, &trace, &camera, &from);
    let scene = Scene { grid: &grid, solids: &solids, trace: &trace };
    let mut predictor = Predictor::new();
    assert_eq!(predictor.predict(&scene, &camera, observer.hidden(), &[from], 0.0, 0.0), Ok(Some(&[0.0][..])));
    assert_eq!(predictor.predict(&scene, &camera, observer.hidden(), &[from], 0.0, 1.0), Ok(Some(&[1.0][..])));
    assert_eq!(predictor.predict(&scene, &camera, &Default::default(), &[from], 0.0, 1.0), Ok(None));
}

#[test]
fn a_look_past_the_recording_or_from_below_the_ground_is_refused() {
    let (grid, trace, solids) = (street(), standing(&[]), Solids::default());
    let scene = Scene { grid: &grid, solids: &solids, trace: &trace };
    let mut observer = Observer::new();
    let mut refusal = |altitude_m: f64, t_s: f64| {
        observer.observe(&scene, &camera(PAPER), &viewpoint(0.0, 0.0, altitude_m, 0.0), t_s).unwrap_err()
    };
    assert_eq!(refusal(10.0, 0.1), SenseError::Trace(TraceError::PastEnd { t_s: 0.1, duration_s: 0.0 }));
    assert!(matches!(refusal(10.0, f64::NAN), SenseError::Trace(TraceError::NotATime { .. })));
    assert!(matches!(refusal(0.0, 0.0), SenseError::Camera(_)));
    assert!(matches!(refusal(f64::NAN, 0.0), SenseError::Camera(_)));
}

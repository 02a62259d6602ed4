//! The mission's kernel on meshes of a few squares: lines fitted into a mesh, commands that cut others short.

use pavetwin_core::geometry::Vec2;
use pavetwin_core::mission::{
    Battery, DrainCurve, Event, Flight, FlightError, Ground, Mode, Settings, Steer, course, nearest_reachable, rest_of,
    shortened,
};
use pavetwin_core::navigation::{Limits, NavMesh};
use pavetwin_core::sensing::{Solids, SurfaceGrid, Trace, TraceColumns};
use std::sync::Arc;
use support::{AGENT, DEFAULT, camera};

mod support;

fn at(x: f64, y: f64) -> Vec2 {
    Vec2::new(x, y)
}

/// Rectangles given by their south-west and north-east corners; those that share a whole side are joined.
fn mesh(rectangles: &[(Vec2, Vec2)]) -> NavMesh {
    let mut vertices: Vec<Vec2> = Vec::new();
    let mut polygons = Vec::new();
    for (low, high) in rectangles {
        let corners = [*low, at(high.x, low.y), *high, at(low.x, high.y)];
        let index = |corner: Vec2, vertices: &mut Vec<Vec2>| {
            let known = vertices.iter().position(|vertex| *vertex == corner);
            known.unwrap_or_else(|| {
                vertices.push(corner);
                vertices.len() - 1
            }) as u32
        };
        polygons.push(corners.map(|corner| index(corner, &mut vertices)).to_vec());
    }
    NavMesh::from_polygons(&vertices, &polygons).expect("a mesh")
}

/// A strip from 0 to 100 m, and an island behind a gap.
fn strip_and_island() -> NavMesh {
    mesh(&[(at(0.0, -5.0), at(50.0, 5.0)), (at(50.0, -5.0), at(100.0, 5.0)), (at(110.0, -5.0), at(150.0, 5.0))])
}

/// A ring of squares around a hole from 20 to 30 m.
fn ring() -> NavMesh {
    let mut squares = Vec::new();
    for (x0, x1) in [(0.0, 20.0), (20.0, 30.0), (30.0, 50.0)] {
        for (y0, y1) in [(-20.0, -5.0), (-5.0, 5.0), (5.0, 20.0)] {
            if (x0, y0) != (20.0, -5.0) {
                squares.push((at(x0, y0), at(x1, y1)));
            }
        }
    }
    mesh(&squares)
}

fn length(path: &[Vec2]) -> f64 {
    path.windows(2).map(|leg| leg[0].distance(leg[1])).sum()
}

#[test]
fn a_course_inside_the_mesh_is_the_line_itself() {
    let line = [at(10.0, 1.0), at(40.0, -2.0), at(90.0, 3.0)];
    assert_eq!(course(&strip_and_island(), line[0], &line).unwrap()[1..], line);
}

#[test]
fn a_course_goes_round_a_hole_and_back_to_the_line() {
    let mesh = ring();
    let flown = course(&mesh, at(5.0, 0.0), &[at(5.0, 0.0), at(45.0, 0.0)]).unwrap();
    assert!(flown.windows(2).all(|leg| mesh.segment_inside(leg[0], leg[1])));
    assert_eq!(flown.last(), Some(&at(45.0, 0.0)));
    let on_line = flown.iter().filter(|point| point.y == 0.0).map(|point| point.x);
    let (near, far) = (on_line.clone().filter(|x| *x < 25.0).fold(0.0, f64::max), on_line.fold(0.0, f64::max));
    assert!(near > 18.0, "the line is left at {near}");
    assert_eq!(far, 45.0);
    assert!(length(&flown) < 55.0);
}

#[test]
fn a_course_leaves_out_what_cannot_be_reached() {
    let mesh = strip_and_island();
    let flown = course(&mesh, at(80.0, 0.0), &[at(80.0, 0.0), at(140.0, 0.0)]).unwrap();
    assert!(flown.iter().all(|point| point.x <= 100.0));
    assert!(flown.last().unwrap().x > 98.0);
    assert_eq!(course(&mesh, at(80.0, 0.0), &[at(120.0, 0.0), at(140.0, 0.0)]).unwrap(), [at(80.0, 0.0)]);
    assert_eq!(course(&mesh, at(80.0, 0.0), &[]).unwrap(), [at(80.0, 0.0)]);
}

#[test]
fn the_nearest_reachable_place_lies_on_the_own_part() {
    let mesh = strip_and_island();
    assert_eq!(nearest_reachable(&mesh, at(10.0, 0.0), at(60.0, 2.0)), at(60.0, 2.0));
    assert!(nearest_reachable(&mesh, at(10.0, 0.0), at(140.0, 2.0)).distance(at(100.0, 2.0)) < 1e-9);
    assert_eq!(nearest_reachable(&mesh, at(120.0, 0.0), at(140.0, 2.0)), at(140.0, 2.0));
    assert!(nearest_reachable(&mesh, at(120.0, 0.0), at(20.0, 9.0)).distance(at(110.0, 5.0)) < 1e-9);
}

#[test]
fn a_path_is_shortened_from_its_end_down_to_its_start() {
    let path = [at(0.0, 0.0), at(10.0, 0.0), at(10.0, 10.0)];
    assert_eq!(shortened(&path, 0.0), path);
    assert_eq!(shortened(&path, 4.0), [at(0.0, 0.0), at(10.0, 0.0), at(10.0, 6.0)]);
    assert_eq!(shortened(&path, 15.0), [at(0.0, 0.0), at(5.0, 0.0)]);
    assert_eq!(shortened(&path, 99.0), [at(0.0, 0.0)]);
}

#[test]
fn the_rest_of_a_path_begins_at_the_place_nearest_to_the_position() {
    let path = [at(0.0, 0.0), at(10.0, 0.0), at(10.0, 10.0)];
    assert_eq!(rest_of(&path, at(4.0, 3.0)), [at(4.0, 0.0), at(10.0, 0.0), at(10.0, 10.0)]);
    assert_eq!(rest_of(&path, at(14.0, 7.0)), [at(10.0, 7.0), at(10.0, 10.0)]);
    assert_eq!(rest_of(&path, at(-5.0, -5.0)), path);
    assert!(rest_of(&[], at(0.0, 0.0)).is_empty());
}

fn settings() -> Settings {
    let limits = |speed_mps| Limits { speed_mps, ..AGENT };
    Settings {
        time_step_s: 0.05,
        altitude_m: 10.0,
        radius_m: 0.5,
        clearance_m: 1.0,
        inspect: limits(5.0),
        transit: limits(10.0),
        stopping_distance_m: 1.0,
        climb_speed_mps: 3.0,
        camera: camera(DEFAULT),
        look_steps: 6,
        capture_steps: 12,
        every_capture: false,
        threshold: 0.7,
        min_visible_fraction: 0.35,
        battery: Battery {
            drain: DrainCurve {
                per_s: vec![1.0 / 1800.0],
                lift_per_s: vec![0.0],
                step_mps: 1.0,
                per_m_climbed: 0.0,
                wind: Vec2::ZERO,
            },
            reserve: 0.15,
        },
    }
}

fn flight(settings: Settings) -> Flight {
    let street = [at(0.0, -3.5), at(100.0, -3.5), at(100.0, 3.5), at(0.0, 3.5)];
    let grid = SurfaceGrid::from_rings(&[street.to_vec()], 0.25).expect("a grid");
    let ground = Ground::new(strip_and_island(), Solids::default(), vec![grid], Vec::new(), &[]).expect("a ground");
    let empty = TraceColumns { step_s: 0.5, step_offsets: vec![0; 2002], ..TraceColumns::default() };
    let trace = Trace::new(empty).expect("a trace");
    Flight::new(Arc::new(ground), Arc::new(trace), settings, at(2.0, 0.0)).expect("a flight")
}

fn arrive(flight: &mut Flight) {
    assert_eq!(flight.advance(), Ok(Event::Arrived));
}

#[test]
fn a_flight_home_begun_at_speed_brakes_first() {
    let small = DrainCurve {
        per_s: vec![1.0 / 40.0],
        lift_per_s: vec![0.0],
        step_mps: 1.0,
        per_m_climbed: 0.0,
        wind: Vec2::ZERO,
    };
    let battery = Battery { drain: small, reserve: 0.15 };
    let mut flight = flight(Settings { battery, ..settings() });
    flight.climb_to(10.0);
    arrive(&mut flight);
    flight.inspect(0, &[at(2.0, 0.0), at(98.0, 0.0)]).expect("an inspection");
    assert_eq!(flight.advance(), Ok(Event::BatteryLow));
    let (speed_mps, from) = (flight.speed_mps(), flight.viewpoint().position);
    assert!(speed_mps > 4.0);
    flight.fly_home().expect("a way home");
    assert_eq!(flight.speed_mps(), speed_mps);
    assert_eq!(flight.mode(), Mode::Home);
    arrive(&mut flight);
    assert!(flight.viewpoint().position.distance(at(2.0, 0.0)) < 1e-9);
    assert_eq!(flight.speed_mps(), 0.0);
    let furthest = flight.track().x_m.iter().copied().fold(0.0, f64::max);
    assert!(furthest > from.x && furthest <= from.x + speed_mps * speed_mps / 16.0 + 0.01);
}

#[test]
fn what_is_left_of_an_inspection_reaches_to_the_lines_end() {
    let mut flight = flight(Settings { threshold: 0.0, ..settings() });
    flight.climb_to(10.0);
    arrive(&mut flight);
    flight.inspect(0, &[at(2.0, 0.0), at(98.0, 0.0)]).expect("an inspection");
    assert!((length(&flight.remaining()) - 96.0).abs() < 1e-9);
    arrive(&mut flight);
    assert!(flight.viewpoint().position.distance(at(97.0, 0.0)) < 1e-9);
    assert!(flight.surface_coverage(0) > 0.9);
}

#[test]
fn a_place_on_the_island_is_approached_as_near_as_can_be() {
    let mut flight = flight(settings());
    flight.climb_to(10.0);
    arrive(&mut flight);
    flight.fly_to(at(130.0, 3.0), Mode::Transit, false).expect("a way");
    arrive(&mut flight);
    assert!(flight.viewpoint().position.distance(at(100.0, 3.0)) < 1e-6);
}

/// Flies by hand until a moment, past what needs no answer here.
fn steer_until(flight: &mut Flight, wanted: Steer, until_s: f64) {
    flight.steer(0, wanted).expect("steering");
    while flight.advance_until(until_s).expect("a flight") != Event::Paused {}
}

fn in_the_air() -> Flight {
    let mut flight = flight(settings());
    flight.climb_to(10.0);
    arrive(&mut flight);
    flight
}

const AHEAD: Steer = Steer { ahead_mps: 5.0, left_mps: 0.0, turn_rad_s: 0.0 };
const STILL: Steer = Steer { ahead_mps: 0.0, left_mps: 0.0, turn_rad_s: 0.0 };

#[test]
fn by_hand_it_flies_as_it_looks_within_the_limits_of_transit() {
    let mut flight = in_the_air();
    let begun_s = flight.time_s();
    steer_until(&mut flight, Steer { ahead_mps: 99.0, ..STILL }, begun_s + 3.0);
    assert!((flight.speed_mps() - 10.0).abs() < 1e-3, "{}", flight.speed_mps());
    assert!(flight.viewpoint().position.y.abs() < 1e-3);
    let mut before = flight.speed_mps();
    while flight.speed_mps() > 0.0 {
        let now_s = flight.time_s();
        steer_until(&mut flight, STILL, now_s + 0.05);
        assert!(before - flight.speed_mps() <= AGENT.acceleration_mps2 * 0.05 + 1e-6);
        before = flight.speed_mps();
    }
    let (turning_s, yaw_rad) = (flight.time_s(), flight.viewpoint().yaw_rad);
    steer_until(&mut flight, Steer { turn_rad_s: 99.0, ..STILL }, turning_s + 1.0);
    assert!((flight.viewpoint().yaw_rad - yaw_rad - AGENT.yaw_rate_rad_s).abs() < 1e-9);
    steer_until(&mut flight, Steer { turn_rad_s: 99.0, ..STILL }, turning_s + 2.0);
    let from = flight.viewpoint().position;
    steer_until(&mut flight, Steer { ahead_mps: f64::NAN, left_mps: 2.0, ..STILL }, turning_s + 4.0);
    let moved = flight.viewpoint().position - from;
    assert!(moved.x < -3.0 && moved.y.abs() < 0.1, "after a quarter turn to the left, left is west: {moved:?}");
}

#[test]
fn by_hand_it_brakes_before_the_border_and_stays_inside() {
    let mut flight = in_the_air();
    let begun_s = flight.time_s();
    let mesh = strip_and_island();
    let mut before = Vec2::ZERO;
    for step in 1..400 {
        steer_until(&mut flight, Steer { ahead_mps: 10.0, left_mps: 10.0, ..STILL }, begun_s + 0.05 * f64::from(step));
        assert!(mesh.contains(flight.viewpoint().position));
        assert!((flight.velocity_mps() - before).length() <= AGENT.acceleration_mps2 * 0.05 + 1e-3);
        before = flight.velocity_mps();
    }
    let end = flight.viewpoint().position;
    assert!(end.distance(at(100.0, 5.0)) < 1.0, "in the corner: {end:?}");
}

#[test]
fn steering_shows_the_surface_and_comes_home_from_rest() {
    let mut flight = in_the_air();
    let begun_s = flight.time_s();
    steer_until(&mut flight, AHEAD, begun_s + 6.0);
    let seen = flight.surface_coverage(0);
    assert!(seen > 0.1, "{seen}");
    assert_eq!(flight.captures().time_s.len(), 10, "one each 0.6 s");
    assert_eq!(flight.mode(), Mode::Inspect);
    let speed_mps = flight.speed_mps();
    assert_eq!(flight.fly_home(), Err(FlightError::StillMoving { speed_mps }));
    steer_until(&mut flight, AHEAD, begun_s + 12.0);
    assert!(flight.surface_coverage(0) > 1.5 * seen);
    steer_until(&mut flight, STILL, begun_s + 15.0);
    assert_eq!(flight.speed_mps(), 0.0);
    flight.fly_home().expect("a way home");
    arrive(&mut flight);
    assert!(flight.viewpoint().position.distance(at(2.0, 0.0)) < 1e-9);
}

#[test]
fn the_same_commands_at_the_same_moments_fly_the_same_whatever_the_pauses() {
    let track = |pause_s: f64| {
        let mut flight = in_the_air();
        for (wanted, until_s) in [(AHEAD, 8.0), (Steer { turn_rad_s: 0.5, ..AHEAD }, 9.5), (STILL, 14.0)] {
            flight.steer(0, wanted).expect("steering");
            while flight.time_s() < until_s - 1e-9 {
                let to_s = (flight.time_s() + pause_s).min(until_s);
                while flight.advance_until(to_s).expect("a flight") != Event::Paused {}
            }
        }
        let track = flight.track();
        (track.time_s.clone(), track.x_m.clone(), track.y_m.clone(), track.yaw_rad.clone(), track.visibility.clone())
    };
    let (often, seldom) = (track(0.1), track(3.7));
    assert_eq!(format!("{often:?}"), format!("{seldom:?}"), "as text, where undefined values equal each other");
}

#[test]
fn a_segment_that_is_not_there_is_refused() {
    let mut flight = flight(settings());
    let unknown = Err(FlightError::UnknownSegment { segment: 7, segments: 1 });
    assert_eq!(flight.inspect(7, &[at(2.0, 0.0), at(98.0, 0.0)]), unknown);
    assert_eq!(flight.revisit(7, 1.0), unknown);
    assert_eq!(flight.steer(7, STILL), unknown);
}

#[test]
fn a_flight_past_the_recording_asks_for_more_and_takes_no_other() {
    let mut flight = flight(settings());
    flight.climb_to(10.0);
    arrive(&mut flight);
    flight.revisit(0, 2000.0).expect("a stay");
    let mut event = flight.advance();
    while matches!(event, Ok(Event::Captured(_))) {
        event = flight.advance();
    }
    assert!(matches!(event, Ok(Event::RecordingEnds | Event::BatteryLow)));
    let short = TraceColumns { step_s: 0.5, step_offsets: vec![0; 3], ..TraceColumns::default() };
    let short = Arc::new(Trace::new(short).expect("a trace"));
    assert_eq!(flight.extend(short), Err(FlightError::OtherRecording));
}

#[test]
fn settings_that_are_no_mission_are_refused_by_name() {
    for (spoil, name) in [
        ((|s| s.time_step_s = 0.0) as fn(&mut Settings), "time_step_s"),
        (|s| s.altitude_m = f64::NAN, "altitude_m"),
        (|s| s.look_steps = 0, "look_steps"),
        (|s| s.clearance_m = -1.0, "clearance_m"),
        (|s| s.battery.reserve = 1.5, "reserve"),
    ] {
        let mut spoilt = settings();
        spoil(&mut spoilt);
        assert!(matches!(spoilt.check(), Err(FlightError::Settings(error)) if error.name == name));
    }
    let limits = Limits { yaw_rate_rad_s: 0.0, ..AGENT };
    assert!(matches!(Settings { transit: limits, ..settings() }.check(), Err(FlightError::NavMesh(_))));
}

//! What a step of a mission costs: climb, fly to a street, inspect it under high traffic, fly home, land. Criterion's
//! elements are time steps of 0.05 s.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::mission::{Battery, DefectTarget, DrainCurve, Event, Flight, Ground, GroundError, Settings};
use pavetwin_core::navigation::{BakeConfig, Limits, NavMesh};
use pavetwin_core::sensing::{Body, BodyClass, Prism, Solids, SurfaceGrid, Trace, TraceColumns};
use support::{AGENT, DEFAULT, camera};

#[path = "../tests/support/mod.rs"]
mod support;

const TIME_STEP_S: f64 = 0.05;
const STREET_M: f64 = 136.0;
/// Four lanes at 30 vehicles a kilometre, two sidewalks at 120 pedestrians a kilometre.
const VEHICLES: u32 = 16;
const WALKERS: u32 = 33;
const DEFECTS: u32 = 30;
const TRACE_S: f64 = 180.0;
const TRACE_STEP_S: f64 = 0.5;
const YAW_RAD: f64 = 0.5;

/// A place on the street, metres along it from its middle and to the left of its centre line.
fn on_street(along_m: f64, left_m: f64) -> Vec2 {
    let ahead = Vec2::from_yaw(YAW_RAD);
    ahead * along_m + ahead.left() * left_m
}

/// The `i`-th of evenly scattered numbers in [0, 1): multiples of the golden ratio's fraction.
fn scattered(i: u32) -> f64 {
    (f64::from(i) * 0.618_033_988_749_895).fract()
}

fn rectangle(half_length_m: f64, half_width_m: f64) -> Vec<Vec2> {
    let corner = |(x, y): (f64, f64)| on_street(x * half_length_m, y * half_width_m);
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner).to_vec()
}

fn ground() -> Ground {
    let (vertices, triangles) = (rectangle(120.0, 15.0), [[0, 1, 2], [0, 2, 3]]);
    let mesh = NavMesh::bake(&vertices, &triangles, &BakeConfig::new(0.25, 0.5)).expect("a street bakes");
    let tree = |i: u32| {
        let centre = on_street(f64::from(i) * 8.0 - 64.0, if i.is_multiple_of(2) { 8.0 } else { -8.0 });
        let corners = (0..12).map(|k| centre + Vec2::from_yaw(TAU * f64::from(k) / 12.0) * 2.0);
        Prism::new(corners.collect(), 3.0, 7.0).expect("a crown")
    };
    let defect = |i: u32| {
        let centre = on_street((scattered(i) - 0.5) * STREET_M, (scattered(7 * i + 3) - 0.5) * 13.0);
        DefectTarget::at(centre)
    };
    let grid = SurfaceGrid::from_rings(&[rectangle(0.5 * STREET_M, 7.0)], 0.25).expect("a grid");
    let defects: Vec<DefectTarget> = (0..DEFECTS).map(defect).collect();
    let solids = Solids::new((0..17).map(tree).collect::<Vec<Prism>>());
    let ground = Ground::new(mesh, solids, vec![grid], defects, &[0; DEFECTS as usize]).expect("a ground");
    for (number, defect) in (0..).zip(&ground.defects) {
        let points = (0..16).map(|k| defect.centre + Vec2::new(f64::from(k % 4), f64::from(k / 4)) * 0.1).collect();
        ground.sample(number, || Ok::<_, GroundError>(points)).expect("points");
    }
    ground
}

/// Vehicles drive to and fro on their lanes at up to 8 m/s, pedestrians walk along the kerbs.
fn traffic() -> Trace {
    let steps = (TRACE_S / TRACE_STEP_S) as u32 + 1;
    let count = VEHICLES + WALKERS;
    let body = |agent: u32| match agent {
        _ if agent < VEHICLES => {
            Body { class: BodyClass::Vehicle, length_m: 4.6, width_m: 1.8, height_m: 1.6, base_m: 0.0 }
        }
        _ => Body { class: BodyClass::Pedestrian, length_m: 0.22, width_m: 0.48, height_m: 1.72, base_m: 0.0 },
    };
    let mut columns =
        TraceColumns { step_s: TRACE_STEP_S, bodies: (0..count).map(body).collect(), ..Default::default() };
    columns.step_offsets = (0..=steps).map(|step| step * count).collect();
    for step in 0..steps {
        for agent in 0..count {
            let (fastest_mps, left_m) = if agent < VEHICLES {
                (8.0, f64::from(agent % 4) * 3.5 - 5.25)
            } else {
                (1.4, if agent.is_multiple_of(2) { 7.5 } else { -7.5 })
            };
            let speed_mps = fastest_mps * (0.4 + 0.6 * scattered(3 * agent + 1));
            // Round the street and back: a lane of twice its length, folded.
            let way_m = (scattered(agent) * 2.0 * STREET_M + speed_mps * f64::from(step) * TRACE_STEP_S)
                .rem_euclid(2.0 * STREET_M);
            let back = way_m > STREET_M;
            let along_m = if back { 1.5 * STREET_M - way_m } else { way_m - 0.5 * STREET_M };
            let at = on_street(along_m, left_m);
            columns.agent.push(agent);
            columns.x_m.push(at.x);
            columns.y_m.push(at.y);
            columns.yaw_rad.push((if back { YAW_RAD - 0.5 * TAU } else { YAW_RAD }) as f32);
            columns.speed_mps.push(speed_mps as f32);
        }
    }
    Trace::new(columns).expect("a trace")
}

fn settings(altitude_m: f64) -> Settings {
    let inspect = AGENT;
    Settings {
        time_step_s: TIME_STEP_S,
        altitude_m,
        radius_m: 0.5,
        clearance_m: 1.0,
        inspect,
        transit: Limits { speed_mps: 10.0, ..inspect },
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
                per_s: vec![1.0 / 1680.0; 32],
                lift_per_s: vec![0.0; 32],
                step_mps: 0.5,
                per_m_climbed: 0.0,
                wind: Vec2::ZERO,
            },
            reserve: 0.15,
        },
    }
}

/// Out and back over the street; what needs deciding is left undecided. Answers the steps flown.
fn fly(ground: &Arc<Ground>, trace: &Arc<Trace>, altitude_m: f64) -> u64 {
    let base = on_street(-100.0, 0.0);
    let mut flight = Flight::new(ground.clone(), trace.clone(), settings(altitude_m), base).expect("a flight");
    let line = [(-68.0, 3.5), (68.0, 3.5), (68.0, -3.5), (-68.0, -3.5)].map(|(x, y)| on_street(x, y));
    let commands: [&dyn Fn(&mut Flight); 5] = [
        &|flight| flight.climb_to(altitude_m),
        &|flight| flight.fly_to(line[0], pavetwin_core::mission::Mode::Transit, false).expect("a way"),
        &|flight| flight.inspect(0, &line).expect("a line"),
        &|flight| flight.fly_home().expect("a way home"),
        &|flight| flight.climb_to(0.0),
    ];
    for command in commands {
        command(&mut flight);
        loop {
            match flight.advance().expect("it flies") {
                Event::Arrived => break,
                Event::RecordingEnds => panic!("the recording is too short"),
                event => drop(black_box(event)),
            }
        }
    }
    (flight.time_s() / TIME_STEP_S).round() as u64
}

fn mission(criterion: &mut Criterion) {
    let (ground, trace) = (Arc::new(ground()), Arc::new(traffic()));
    let mut group = criterion.benchmark_group("mission");
    for altitude_m in [6.0, 15.0] {
        group.throughput(Throughput::Elements(fly(&ground, &trace, altitude_m)));
        group.bench_function(format!("inspection at {altitude_m} m"), |b| b.iter(|| fly(&ground, &trace, altitude_m)));
    }
    group.finish();
}

criterion_group!(benches, mission);
criterion_main!(benches);

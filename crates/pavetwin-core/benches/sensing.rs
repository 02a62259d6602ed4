//! What one look costs: high traffic at 15 m, in a town and in a city a hundred times as large around the same camera.

use criterion::{Criterion, criterion_group, criterion_main};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{
    Body, BodyClass, Observer, Predictor, Prism, Scene, Solids, SurfaceGrid, Trace, TraceColumns, Viewpoint,
};
use std::hint::black_box;
use support::{DEFAULT, PAPER, camera};

#[path = "../tests/support/mod.rs"]
mod support;

const STEPS: u32 = 40;
const STEP_S: f64 = 0.5;
/// Agents near the camera: about what high traffic puts below a footprint at 15 m, and a little round it.
const NEAR_CARS: u32 = 8;
const NEAR_WALKERS: u32 = 12;
/// Agents and solids on each square kilometre elsewhere.
const AGENTS_PER_KM2: u32 = 1200;
const SOLIDS_PER_KM2: u32 = 4000;
/// The street runs at an angle to the lattice, which is the dearer case.
const STREET_YAW_RAD: f64 = 0.5;

/// A fixed sequence of numbers in [0, 1) (Steele and others 2014, SplitMix64).
struct Sequence(u64);

impl Sequence {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    /// A place in the city that leaves the street round the origin alone.
    fn elsewhere(&mut self, side_m: f64) -> Vec2 {
        loop {
            let half_m = 0.5 * side_m;
            let place = Vec2::new(self.between(-half_m, half_m), self.between(-half_m, half_m));
            if place.length() > 150.0 {
                return place;
            }
        }
    }
}

fn on_street(along_m: f64, left_m: f64) -> Vec2 {
    let ahead = Vec2::from_yaw(STREET_YAW_RAD);
    ahead * along_m + ahead.left() * left_m
}

struct City {
    grid: SurfaceGrid,
    solids: Solids,
    trace: Trace,
}

impl City {
    /// A square city; the street, its traffic and its trees are the same whatever its side.
    fn new(side_km: u32) -> Self {
        let (mut sequence, side_m) = (Sequence(1), f64::from(side_km) * 1000.0);
        let outline = [(-68.0, -7.0), (68.0, -7.0), (68.0, 7.0), (-68.0, 7.0)].map(|(x, y)| on_street(x, y)).to_vec();
        let mut prisms = Vec::new();
        for i in 0..17 {
            let at = on_street(f64::from(i) * 8.0 - 64.0, if i % 2 == 0 { 8.0 } else { -8.0 });
            prisms.push(upright(at, 0.2, 8, 0.0, 3.0));
            prisms.push(upright(at, 2.0, 12, 3.0, 7.0));
        }
        for _ in 0..SOLIDS_PER_KM2 * side_km * side_km {
            prisms.push(upright(sequence.elsewhere(side_m), 6.0, 4, 0.0, 12.0));
        }
        Self {
            grid: SurfaceGrid::from_rings(&[outline], 0.25).expect("a grid"),
            solids: Solids::new(prisms),
            trace: traffic(side_km),
        }
    }

    fn scene(&self) -> Scene<'_> {
        Scene { grid: &self.grid, solids: &self.solids, trace: &self.trace }
    }
}

fn upright(centre: Vec2, radius_m: f64, corners: u32, base_m: f64, top_m: f64) -> Prism {
    let corner = |i: u32| centre + Vec2::from_yaw(std::f64::consts::TAU * f64::from(i) / f64::from(corners)) * radius_m;
    Prism::new((0..corners).map(corner).collect(), base_m, top_m).expect("a prism")
}

fn traffic(side_km: u32) -> Trace {
    // Those near the camera are drawn first, from a sequence of their own: they are the same in every city.
    let mut sequence = Sequence(2);
    let near = NEAR_CARS + NEAR_WALKERS;
    let count = near + AGENTS_PER_KM2 * side_km * side_km;
    let body = |agent: u32| match agent {
        _ if agent < NEAR_CARS || agent >= near && agent.is_multiple_of(2) => {
            Body { class: BodyClass::Vehicle, length_m: 4.6, width_m: 1.8, height_m: 1.6, base_m: 0.0 }
        }
        _ => Body { class: BodyClass::Pedestrian, length_m: 0.22, width_m: 0.48, height_m: 1.72, base_m: 0.0 },
    };
    // Start and velocity. Those near the camera creep, so that as many stay below it for the whole recording.
    let motions: Vec<(Vec2, Vec2)> = (0..count)
        .map(|agent| match agent {
            _ if agent >= near => {
                let velocity = Vec2::from_yaw(sequence.between(-3.0, 3.0)) * sequence.between(0.0, 14.0);
                (sequence.elsewhere(0.99 * f64::from(side_km) * 1000.0), velocity)
            }
            _ => (on_street(sequence.between(-9.0, 9.0), sequence.between(-7.0, 7.0)), on_street(0.1, 0.0)),
        })
        .collect();
    let mut columns = TraceColumns { step_s: STEP_S, bodies: (0..count).map(body).collect(), ..Default::default() };
    columns.step_offsets = (0..=STEPS).map(|step| step * count).collect();
    for step in 0..STEPS {
        for (agent, (start, velocity)) in motions.iter().enumerate() {
            let at = *start + *velocity * (f64::from(step) * STEP_S);
            columns.agent.push(agent as u32);
            columns.x_m.push(at.x);
            columns.y_m.push(at.y);
            columns.yaw_rad.push(velocity.yaw_rad() as f32);
            columns.speed_mps.push(velocity.length() as f32);
        }
    }
    Trace::new(columns).expect("a trace")
}

/// The `i`-th look of a flight along the street: 0.3 s and 0.4 m after the one before, to and fro.
fn look(i: u32) -> (Viewpoint, f64) {
    let position = on_street(f64::from(i % 10) * 0.4 - 2.0, 1.0);
    (Viewpoint { position, altitude_m: 15.0, yaw_rad: STREET_YAW_RAD }, f64::from(i % 64) * 0.3)
}

fn sensing(criterion: &mut Criterion) {
    for (name, side_km) in [("town", 1), ("city_100x", 10)] {
        let city = City::new(side_km);
        for (window, rule) in [("default", DEFAULT), ("paper", PAPER)] {
            let (camera, mut observer, mut i) = (camera(rule), Observer::new(), 0);
            criterion.bench_function(&format!("observe/{window}/{name}"), |bench| {
                bench.iter(|| {
                    i += 1;
                    let (viewpoint, t_s) = look(i);
                    black_box(observer.observe(&city.scene(), &camera, &viewpoint, t_s)).expect("a look").visible
                });
            });
        }
        let ((viewpoint, t_s), mut near) = (look(0), 0);
        city.trace.agents_near(viewpoint.position, 12.4, t_s, &mut |_| near += 1).expect("a time");
        assert!(near >= 12, "only {near} agents are near: too few for high traffic");
        eprintln!("{near} agents near the camera, {} in all", city.trace.bodies().len());
        let mut i = 0;
        criterion.bench_function(&format!("agents_near/{name}"), |bench| {
            bench.iter(|| {
                i += 1;
                let ((viewpoint, t_s), mut found) = (look(i), 0);
                let visit = &mut |pose| {
                    black_box(pose);
                    found += 1;
                };
                city.trace.agents_near(viewpoint.position, 12.4, t_s, visit).expect("a time");
                found
            });
        });
        predict(criterion, &city, name);
    }
}

fn predict(criterion: &mut Criterion, city: &City, name: &str) {
    let (camera, mut observer, mut predictor) = (camera(DEFAULT), Observer::new(), Predictor::new());
    let (from, t_s) = look(0);
    let seen = observer.observe(&city.scene(), &camera, &from, t_s).expect("a look");
    assert!(seen.visible < seen.candidates, "nothing is hidden in this scene: {seen:?}");
    let ring = |i: u32| Vec2::from_yaw(std::f64::consts::TAU * f64::from(i % 8) / 8.0) * (1.5 * f64::from(1 + i / 8));
    let shifted = |shift: Vec2| Viewpoint { position: from.position + shift, ..from };
    let viewpoints: Vec<Viewpoint> = std::iter::once(from).chain((0..16).map(|i| shifted(ring(i)))).collect();
    criterion.bench_function(&format!("predict_17/{name}"), |bench| {
        bench.iter(|| {
            let shares = predictor.predict(&city.scene(), &camera, observer.hidden(), black_box(&viewpoints), t_s, 1.0);
            shares.expect("a look").map(|shares| shares[16])
        });
    });
    let points: Vec<Vec2> = (0..40).map(|i| on_street(f64::from(i % 8) * 0.1, f64::from(i / 8) * 0.1)).collect();
    criterion.bench_function(&format!("visible_fraction_40_points/{name}"), |bench| {
        bench.iter(|| {
            observer.visible_fraction(&city.solids, &city.trace, black_box(&from), t_s, &points).expect("a look")
        });
    });
}

criterion_group!(benches, sensing);
criterion_main!(benches);

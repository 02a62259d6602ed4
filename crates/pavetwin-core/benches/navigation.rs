//! How long baking, path search and flight take over a square kilometre of streets.

use std::f64::consts::FRAC_PI_6;
use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::navigation::{BakeConfig, Follower, Motion, NavMesh, Rail};
use support::AGENT;

#[path = "../tests/support/mod.rs"]
mod support;

/// Ten streets each way, `size_m` long and 18 m wide, turned by `yaw_rad`.
fn street_grid(size_m: f64, yaw_rad: f64) -> (Vec<Vec2>, Vec<[u32; 3]>) {
    let east = Vec2::from_yaw(yaw_rad);
    let north = east.left();
    let streets = (size_m / 100.0).round() as u32;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for street in 0..streets {
        let middle_m = (f64::from(street) + 0.5) * 100.0;
        for (along, across) in [(east, north), (north, east)] {
            let corner = |s_m: f64, side_m: f64| along * s_m + across * (middle_m + side_m);
            let first = vertices.len() as u32;
            vertices.extend([corner(0.0, -9.0), corner(size_m, -9.0), corner(size_m, 9.0), corner(0.0, 9.0)]);
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
    }
    (vertices, triangles)
}

fn bake(size_m: f64, yaw_rad: f64) -> NavMesh {
    let (vertices, triangles) = street_grid(size_m, yaw_rad);
    NavMesh::bake(&vertices, &triangles, &BakeConfig::new(0.25, 0.5)).expect("a street grid bakes")
}

fn ends(size_m: f64, yaw_rad: f64) -> (Vec2, Vec2) {
    let (east, north) = (Vec2::from_yaw(yaw_rad), Vec2::from_yaw(yaw_rad).left());
    (east * 52.0 + north * 25.0, east * (size_m - 25.0) + north * (size_m - 53.0))
}

fn navigation(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("navigation");
    group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    group.sample_size(10);
    for (name, yaw_rad) in [("straight", 0.0), ("oblique", FRAC_PI_6)] {
        group.bench_function(format!("bake 1 km², {name}"), |b| b.iter(|| bake(1000.0, yaw_rad)));
    }
    group.sample_size(100);
    for (size_m, name, yaw_rad) in [
        (1000.0, "1 km², straight", 0.0),
        (1000.0, "1 km², oblique", FRAC_PI_6),
        (3000.0, "9 km², straight", 0.0),
        (3000.0, "9 km², oblique", FRAC_PI_6),
    ] {
        let mesh = bake(size_m, yaw_rad);
        println!("{name}: {} polygons, {} corners", mesh.polygons().len(), mesh.vertices().len());
        let (vertices, polygons) = (mesh.vertices().to_vec(), mesh.polygons().to_vec());
        group.sample_size(10).bench_function(format!("open {name}"), |b| {
            b.iter(|| NavMesh::from_polygons(&vertices, &polygons).expect("a mesh"))
        });
        group.sample_size(100);
        let (start, goal) = ends(size_m, yaw_rad);
        group.bench_function(format!("path across {name}"), |b| {
            b.iter(|| mesh.path(black_box(start), goal).expect("a way"))
        });
        let near = mesh.nearest(start + Vec2::from_yaw(yaw_rad) * 200.0 + Vec2::from_yaw(yaw_rad).left() * 200.0);
        group.bench_function(format!("path of 400 m, {name}"), |b| {
            b.iter(|| mesh.path(black_box(start), near).expect("a way"))
        });
        group.bench_function(format!("contains, {name}"), |b| b.iter(|| mesh.contains(black_box(start))));
        group.bench_function(format!("nearest, {name}"), |b| {
            b.iter(|| mesh.nearest(black_box(start + Vec2::new(30.0, 30.0))))
        });
        let path = mesh.path(start, goal).expect("a way");
        let limits = AGENT;
        group.bench_function(format!("rail across {name}"), |b| {
            b.iter(|| Rail::new(&mesh, &path, &limits).expect("flyable"))
        });
        let begin = Follower::new(Rail::new(&mesh, &path, &limits).expect("flyable"), 0.0);
        let mut follower = begin.clone();
        group.bench_function(format!("follower step, {name}"), |b| {
            b.iter(|| {
                follower.step(0.05);
                if follower.arrived() {
                    follower = begin.clone();
                }
            })
        });
    }
    group.finish();
}

criterion_group!(benches, navigation);
criterion_main!(benches);

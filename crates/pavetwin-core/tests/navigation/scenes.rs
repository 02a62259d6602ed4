//! Flight domains to test on: unions of squares, corridors and street grids, made without any triangulation library.

use pavetwin_core::geometry::Vec2;
use pavetwin_core::navigation::{BakeConfig, NavMesh};
use proptest::prelude::*;

/// `cases` random scenes a law, unless the environment variable PROPTEST_CASES asks for another number.
pub fn config(cases: u32) -> ProptestConfig {
    let asked = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok());
    ProptestConfig { cases: asked.unwrap_or(cases), failure_persistence: None, ..ProptestConfig::default() }
}

/// A flight domain as triangles, and the same domain as a predicate that knows nothing of triangles.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    pub vertices: Vec<Vec2>,
    pub triangles: Vec<[u32; 3]>,
}

impl Scene {
    /// Adds a convex polygon as a fan; odd triangles are wound the other way, since any winding must do.
    pub fn add(&mut self, corners: &[Vec2]) {
        let first = self.vertices.len() as u32;
        self.vertices.extend_from_slice(corners);
        for i in 1..corners.len() as u32 - 1 {
            let (b, c) = if i % 2 == 0 { (i, i + 1) } else { (i + 1, i) };
            self.triangles.push([first, first + b, first + c]);
        }
    }

    /// Adds a straight corridor, `width_m` wide, with square ends.
    pub fn add_corridor(&mut self, from: Vec2, to: Vec2, width_m: f64) {
        let along = (to - from).normalized();
        let half = along.left() * (width_m / 2.0);
        self.add(&[from - half, to - half, to + half, from + half]);
    }

    /// Whether `point` lies in the domain or no further than `margin_m` outside it.
    pub fn contains(&self, point: Vec2, margin_m: f64) -> bool {
        self.triangles.iter().any(|triangle| {
            let [a, b, c] = triangle.map(|i| self.vertices[i as usize]);
            let edges = [(a, b), (b, c), (c, a)];
            let side = |(from, to): (Vec2, Vec2)| (to - from).cross(point - from);
            edges.iter().all(|e| side(*e) >= 0.0)
                || edges.iter().all(|e| side(*e) <= 0.0)
                || edges.iter().any(|(from, to)| distance_to_segment(point, *from, *to) <= margin_m)
        })
    }

    pub fn bake(&self) -> NavMesh {
        NavMesh::bake(&self.vertices, &self.triangles, &BakeConfig::new(0.25, 0.5)).expect("the scene bakes")
    }
}

pub fn distance_to_segment(point: Vec2, from: Vec2, to: Vec2) -> f64 {
    let along = to - from;
    let share = ((point - from).dot(along) / along.dot(along)).clamp(0.0, 1.0);
    point.distance(from + along * share)
}

/// Squares of `side_m`, those for which `open` holds, row by row from the south-west.
pub fn squares(columns: usize, side_m: f64, origin: Vec2, open: &[bool]) -> Scene {
    let mut scene = Scene::default();
    for (i, _) in open.iter().enumerate().filter(|(_, open)| **open) {
        let south_west = origin + Vec2::new((i % columns) as f64, (i / columns) as f64) * side_m;
        let [east, north] = [Vec2::new(side_m, 0.0), Vec2::new(0.0, side_m)];
        scene.add(&[south_west, south_west + east, south_west + east + north, south_west + north]);
    }
    scene
}

/// The squares of [`squares`] as a mesh of polygons, without Recast.
pub fn square_mesh(columns: usize, side_m: f64, origin: Vec2, open: &[bool]) -> NavMesh {
    let scene = squares(columns, side_m, origin, open);
    let polygons: Vec<Vec<u32>> = (0..scene.vertices.len() as u32 / 4).map(|i| (4 * i..4 * i + 4).collect()).collect();
    NavMesh::from_polygons(&scene.vertices, &polygons).expect("squares are convex")
}

/// An 8 × 8 board of squares with a share of them taken out. No two open squares touch at a corner alone: through such
/// a point of no width a line of sight passes, but no path.
pub fn any_board() -> impl Strategy<Value = Vec<bool>> {
    proptest::collection::vec(proptest::bool::weighted(0.7), 64)
        .prop_filter("some square is open", |open| open.iter().any(|open| *open))
        .prop_map(|mut open| {
            for i in (0..64).filter(|i| i % 8 < 7 && *i < 56).rev() {
                let [a, b, c, d] = [i, i + 1, i + 8, i + 9].map(|i| open[i]);
                if a == d && b == c && a != b {
                    (open[i], open[i + 1]) = (true, true);
                }
            }
            for i in (0..56).filter(|i| i % 8 < 7) {
                let [a, b, c, d] = [i, i + 1, i + 8, i + 9].map(|i| open[i]);
                if a == d && b == c && a != b {
                    (open[i + 8], open[i + 9]) = (true, true);
                }
            }
            open
        })
        .prop_filter("no corner joins two squares alone", |open| {
            (0..56)
                .filter(|i| i % 8 < 7)
                .all(|i| open[i] == open[i + 1] || open[i] != open[i + 9] || open[i + 1] != open[i + 8])
        })
}

/// A few corridors in any direction, across a point near the origin, of 4 to 20 m width.
pub fn any_corridors() -> impl Strategy<Value = Scene> {
    let corridor = (-40.0..40.0, -40.0..40.0, 0.0..std::f64::consts::PI, 40.0..150.0, 4.0..20.0);
    (proptest::collection::vec(corridor, 1..6), -3000.0..3000.0_f64, -3000.0..3000.0_f64).prop_map(
        |(corridors, x, y)| {
            let mut scene = Scene::default();
            for (east, north, yaw_rad, length_m, width_m) in corridors {
                let centre = Vec2::new(x + east, y + north);
                let half = Vec2::from_yaw(yaw_rad) * (length_m / 2.0);
                scene.add_corridor(centre - half, centre + half, width_m);
            }
            scene
        },
    )
}

/// Streets that cross at right angles, evenly spaced, in any direction or along the axes: many ways are almost equal.
pub fn any_streets() -> impl Strategy<Value = Scene> {
    let yaw = prop_oneof![Just(0.0), 0.0..std::f64::consts::FRAC_PI_2];
    (2..6_u32, 2..6_u32, yaw, 30.0..60.0_f64, 4.0..20.0_f64).prop_map(|(rows, columns, yaw_rad, spacing_m, width_m)| {
        let (east, north) = (Vec2::from_yaw(yaw_rad), Vec2::from_yaw(yaw_rad).left());
        let at = |column: u32, row: u32| (east * f64::from(column) + north * f64::from(row)) * spacing_m;
        let mut scene = Scene::default();
        (0..rows).for_each(|row| scene.add_corridor(at(0, row), at(columns - 1, row), width_m));
        (0..columns).for_each(|column| scene.add_corridor(at(column, 0), at(column, rows - 1), width_m));
        scene
    })
}

/// A point of the mesh, chosen by three shares in [0, 1).
pub fn point_of(mesh: &NavMesh, shares: (f64, f64, f64)) -> Vec2 {
    let polygons = mesh.polygons();
    let polygon = &polygons[(shares.0 * polygons.len() as f64) as usize % polygons.len()];
    let corner = |i: usize| mesh.vertices()[polygon[i % polygon.len()] as usize];
    let i = 1 + (shares.1 * (polygon.len() - 2) as f64) as usize;
    let inner = (shares.0 * polygons.len() as f64).fract();
    corner(0).lerp(corner(i).lerp(corner(i + 1), inner), shares.2)
}

/// Whole numbers of metres and borders are where geometry fails: shares that hit them often.
pub fn any_shares() -> impl Strategy<Value = (f64, f64, f64)> {
    let share = || prop_oneof![4 => 0.0..1.0, 1 => Just(0.0), 1 => Just(0.5), 1 => Just(1.0)];
    (0.0..1.0, 0.0..1.0, share())
}

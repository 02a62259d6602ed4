//! What must hold of every mesh and every path over it.

use std::collections::BinaryHeap;

use pavetwin_core::geometry::Vec2;
use pavetwin_core::navigation::{BORDER_TOLERANCE_M, BakeConfig, NavMesh, NavMeshError};
use proptest::prelude::*;

use crate::scenes::{Scene, any_board, any_corridors, any_shares, any_streets, config, point_of, square_mesh, squares};

/// One voxel, in metres.
const VOXEL_M: f64 = 0.25;
/// A path may be longer than the shortest by this share: nothing but rounding.
const ROUNDING: f64 = 1.0e-6;

fn length_m(points: &[Vec2]) -> f64 {
    points.windows(2).map(|leg| leg[0].distance(leg[1])).sum()
}

/// The length of the shortest way by a visibility graph over the corners of the mesh's border: every pair that sees
/// each other is an edge, and Dijkstra does the rest. Slow, and all it shares with the search under test is the mesh.
fn visibility_graph_length_m(mesh: &NavMesh, start: Vec2, goal: Vec2) -> Option<f64> {
    let mut nodes = vec![start, goal];
    // Every corner begins one wall, or two where two parts touch.
    nodes.extend(mesh.walls().iter().map(|wall| wall[0]));
    let mut best = vec![f64::INFINITY; nodes.len()];
    best[0] = 0.0;
    let mut open = BinaryHeap::from([(std::cmp::Reverse(0), 0)]);
    while let Some((_, node)) = open.pop() {
        if node == 1 {
            return Some(best[1]);
        }
        for other in 0..nodes.len() {
            let through = best[node] + nodes[node].distance(nodes[other]);
            if through < best[other] - 1.0e-12 && mesh.segment_inside(nodes[node], nodes[other]) {
                best[other] = through;
                open.push((std::cmp::Reverse((through * 1.0e9) as u64), other));
            }
        }
    }
    None
}

fn assert_sound(mesh: &NavMesh) {
    for polygon in mesh.polygons() {
        let count = polygon.len();
        let corner = |i: usize| mesh.vertices()[polygon[i % count] as usize];
        assert!(count >= 3);
        for i in 0..count {
            let along = (corner(i + 1) - corner(i)).normalized();
            for j in 0..count {
                assert!(along.cross(corner(j) - corner(i)) >= -BORDER_TOLERANCE_M, "{polygon:?} is not convex");
            }
            assert!(mesh.contains(corner(i)));
            assert!(mesh.segment_inside(corner(i), corner(i + 1)));
        }
    }
}

/// Samples every polygon's corners, edges and inside.
fn assert_within(mesh: &NavMesh, scene: &Scene, margin_m: f64) {
    for polygon in mesh.polygons() {
        let corners: Vec<Vec2> = polygon.iter().map(|i| mesh.vertices()[*i as usize]).collect();
        for i in 0..corners.len() {
            for j in 0..i {
                let pieces = (corners[i].distance(corners[j]) / 0.5).ceil() as usize;
                for k in 0..=pieces {
                    let point = corners[i].lerp(corners[j], k as f64 / pieces as f64);
                    assert!(scene.contains(point, margin_m), "{point:?} of the mesh is outside the domain");
                }
            }
        }
    }
}

fn assert_path(mesh: &NavMesh, start: Vec2, goal: Vec2) -> Result<(), TestCaseError> {
    let path = mesh.path(start, goal);
    if !mesh.connected(start, goal) {
        prop_assert_eq!(path, Err(NavMeshError::Unreachable { start, goal }));
        return Ok(());
    }
    let path = path.expect("both ends are in the same part");
    prop_assert_eq!((path[0], *path.last().expect("two points")), (start, goal));
    for leg in path.windows(2) {
        prop_assert!(mesh.segment_inside(leg[0], leg[1]), "{:?} leaves the mesh", leg);
    }
    let shortest_m = visibility_graph_length_m(mesh, start, goal).expect("a way exists");
    prop_assert!(
        (length_m(&path) - shortest_m).abs() <= ROUNDING * shortest_m + 1.0e-5,
        "{} against {shortest_m}: {path:?}",
        length_m(&path)
    );
    let back = mesh.path(goal, start).expect("the way back exists");
    let back_m = length_m(&back);
    prop_assert!(
        (back_m - shortest_m).abs() <= ROUNDING * shortest_m + 1.0e-5,
        "{back_m} back against {shortest_m}: {back:?}"
    );
    Ok(())
}

proptest! {
    #![proptest_config(config(48))]

    #[test]
    fn baked_corridors_are_convex_and_inside_the_domain(scene in any_corridors()) {
        let mesh = scene.bake();
        assert_sound(&mesh);
        assert_within(&mesh, &scene, VOXEL_M);
    }

    #[test]
    fn paths_over_baked_corridors_are_the_shortest(scene in any_corridors(), a in any_shares(), b in any_shares()) {
        let mesh = scene.bake();
        assert_path(&mesh, point_of(&mesh, a), point_of(&mesh, b))?;
    }

    #[test]
    fn paths_over_baked_boards_with_holes_are_the_shortest(open in any_board(), a in any_shares(), b in any_shares()) {
        let scene = squares(8, 6.1, Vec2::new(-1000.3, 512.7), &open);
        let mesh = scene.bake();
        assert_sound(&mesh);
        assert_within(&mesh, &scene, VOXEL_M);
        assert_path(&mesh, point_of(&mesh, a), point_of(&mesh, b))?;
    }

    #[test]
    fn paths_over_boards_of_squares_are_the_shortest(open in any_board(), a in any_shares(), b in any_shares()) {
        let mesh = square_mesh(8, 5.0, Vec2::new(100.0, -40.0), &open);
        assert_sound(&mesh);
        assert_path(&mesh, point_of(&mesh, a), point_of(&mesh, b))?;
    }

    #[test]
    fn paths_over_street_grids_are_the_shortest(scene in any_streets(), a in any_shares(), b in any_shares()) {
        let mesh = scene.bake();
        assert_path(&mesh, point_of(&mesh, a), point_of(&mesh, b))?;
    }

    #[test]
    fn nearest_is_inside_and_no_corner_is_nearer(scene in any_corridors(), x in -200.0..200.0, y in -200.0..200.0) {
        let mesh = scene.bake();
        let point = mesh.vertices()[0] + Vec2::new(x, y);
        let near = mesh.nearest(point);
        prop_assert!(mesh.contains(near));
        prop_assert!(mesh.vertices().iter().all(|corner| corner.distance(point) >= near.distance(point) - 1.0e-6));
        prop_assert_eq!(mesh.contains(point), near == point);
    }
}

/// A corridor that meets a wider one in the middle of its long edge.
#[test]
fn t_junctions_are_passable() {
    let corners: Vec<Vec2> =
        [(0.0, 0.0), (20.0, 0.0), (20.0, 4.0), (0.0, 4.0), (8.0, 4.0), (12.0, 4.0), (12.0, 15.0), (8.0, 15.0)]
            .map(|(x, y)| Vec2::new(x, y))
            .to_vec();
    let mesh = NavMesh::from_polygons(&corners, &[vec![0, 1, 2, 3], vec![4, 7, 6, 5]]).expect("convex");
    let path = mesh.path(Vec2::new(1.0, 3.0), Vec2::new(9.0, 14.0)).expect("reachable");
    assert_eq!(path, vec![Vec2::new(1.0, 3.0), Vec2::new(8.0, 4.0), Vec2::new(9.0, 14.0)]);
    assert!((mesh.area_m2() - 124.0).abs() < 1.0e-9);
    assert_eq!(mesh.path(corners[4], corners[5]).expect("along the shared edge").len(), 2);
}

#[test]
fn separate_parts_cannot_be_reached() {
    let mut scene = Scene::default();
    scene.add_corridor(Vec2::new(0.0, 0.0), Vec2::new(50.0, 0.0), 10.0);
    scene.add_corridor(Vec2::new(0.0, 30.0), Vec2::new(50.0, 30.0), 10.0);
    let mesh = scene.bake();
    let (start, goal) = (Vec2::new(5.0, 0.0), Vec2::new(5.0, 30.0));
    assert_eq!(mesh.path(start, goal), Err(NavMeshError::Unreachable { start, goal }));
    assert!(matches!(mesh.path(Vec2::new(5.0, 15.0), goal), Err(NavMeshError::StartOutside { .. })));
    assert!(matches!(mesh.path(start, Vec2::new(5.0, 99.0)), Err(NavMeshError::GoalOutside { .. })));
    assert_eq!(mesh.component_of(Vec2::new(5.0, 15.0)), None);
    assert!(!mesh.segment_inside(start, goal));
}

#[test]
fn a_start_that_misses_the_mesh_by_less_than_a_millimetre_is_taken() {
    let mesh = square_mesh(1, 10.0, Vec2::ZERO, &[true]);
    let path = mesh.path(Vec2::new(5.0, -0.0005), Vec2::new(10.0009, 10.0)).expect("snapped");
    assert!(path.iter().all(|point| mesh.contains(*point)));
    let here = Vec2::new(3.0, 3.0);
    assert_eq!(mesh.path(here, here), Ok(vec![here, here]));
}

/// The mesh keeps the agent's radius, to within a voxel, and does not give away more than it must.
#[test]
fn a_corridor_is_narrowed_by_the_agents_radius() {
    let mut scene = Scene::default();
    scene.add_corridor(Vec2::new(0.0, 0.0), Vec2::new(100.0, 60.0), 12.0);
    let mesh = scene.bake();
    let (length, width) = (100.0_f64.hypot(60.0), 12.0);
    assert!(mesh.area_m2() < (length - 0.5) * (width - 0.5), "{}", mesh.area_m2());
    assert!(mesh.area_m2() > (length - 1.5) * (width - 1.5), "{}", mesh.area_m2());
}

#[test]
fn a_domain_across_many_tiles_is_one_part() {
    let mut scene = Scene::default();
    scene.add_corridor(Vec2::new(-400.0, -380.0), Vec2::new(500.0, 410.0), 10.0);
    scene.add_corridor(Vec2::new(-400.0, 380.0), Vec2::new(500.0, -410.0), 10.0);
    let mesh = scene.bake();
    assert_sound(&mesh);
    assert_within(&mesh, &scene, 0.0);
    let (start, goal) = (mesh.nearest(Vec2::new(-400.0, -380.0)), mesh.nearest(Vec2::new(500.0, -410.0)));
    let path = mesh.path(start, goal).expect("one part");
    let shortest_m = visibility_graph_length_m(&mesh, start, goal).expect("a way exists");
    assert!((length_m(&path) - shortest_m).abs() < 1.0e-4 * shortest_m);
}

#[test]
fn bad_input_is_named() {
    let corners = [Vec2::new(0.0, 0.0), Vec2::new(10.0, 0.0), Vec2::new(0.0, 10.0)];
    let bake = |corners: &[Vec2], config: BakeConfig| NavMesh::bake(corners, &[[0, 1, 2]], &config);
    let usual = BakeConfig::new(0.25, 0.5);
    assert!(matches!(NavMesh::bake(&corners, &[], &usual), Err(NavMeshError::Empty)));
    assert!(matches!(bake(&[corners[0]; 3], usual), Err(NavMeshError::Empty)));
    assert!(matches!(bake(&corners[..2], usual), Err(NavMeshError::UnknownVertex { vertex: 2, .. })));
    assert!(matches!(
        bake(&[corners[0], corners[1], Vec2::new(0.0, f64::NAN)], usual),
        Err(NavMeshError::NotFinite { .. })
    ));
    assert!(matches!(bake(&corners.map(|c| c * 1.0e5), usual), Err(NavMeshError::TooLarge { .. })));
    assert!(matches!(bake(&corners.map(|c| c * 0.1), usual), Err(NavMeshError::NothingLeft { .. })));
    assert!(matches!(bake(&corners, BakeConfig { cell_size_m: 0.0, ..usual }), Err(NavMeshError::BadConfig { .. })));
    let arrow = [corners[0], corners[1], Vec2::new(1.0, 1.0), corners[2]];
    assert_eq!(
        NavMesh::from_polygons(&arrow, &[vec![0, 1, 2, 3]]).unwrap_err(),
        NavMeshError::NotConvex { polygon: 0 }
    );
}

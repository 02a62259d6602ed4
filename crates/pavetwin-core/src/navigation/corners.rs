//! Corners made round: every corner gets a disc, and the line is drawn taut around the discs like a belt.
//!
//! The disc of a corner stands on the inside of the turn, on its bisector. Where the inside is free it touches both
//! legs (a plain fillet, legs unchanged); at an obstacle it passes through the corner itself, so that the line swings
//! out around the obstacle's corner instead of into it. A corner without room keeps radius zero and stays sharp.

use super::mesh::NavMesh;
use crate::geometry::{Vec2, wrap_angle};

/// Corners are rounded with at least this radius, in metres, or left sharp.
const LEAST_RADIUS_M: f64 = 0.4;
/// Each try of a smaller radius takes this share of the one before.
const RADIUS_STEP: f64 = 0.7;
/// Turns below this are left as they are: the yaw follows them within one time step.
const STRAIGHT_RAD: f64 = 0.004;
/// A turn sharper than this has no useful bisector: the agent stops and turns.
const SHARPEST_RAD: f64 = 2.9;
/// Arcs are flown as chords of at most this angle and length.
const CHORD_RAD: f64 = 0.05;
const CHORD_M: f64 = 0.5;

/// A disc that the line touches; a point when its radius is zero.
#[derive(Debug, Clone, Copy)]
struct Disc {
    centre: Vec2,
    radius_m: f64,
    /// 1 when the line turns left around it, −1 when right.
    side: f64,
}

/// A straight piece between two discs.
#[derive(Debug, Clone, Copy)]
struct Leg {
    from: Vec2,
    to: Vec2,
    yaw_rad: f64,
}

/// A piece of the rounded line: straight when both yaws are equal, else a chord of an arc.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    pub to: Vec2,
    /// Tangent at the start and the end, counter-clockwise from east.
    pub yaw_start_rad: f64,
    pub yaw_end_rad: f64,
}

/// Rounds the corners of a line whose straight pieces stay on the mesh. No radius is larger than `widest_m`.
pub(super) fn round(mesh: &NavMesh, points: &[Vec2], widest_m: f64) -> Vec<Piece> {
    let mut discs: Vec<Disc> = points.iter().map(|p| Disc { centre: *p, radius_m: 0.0, side: 1.0 }).collect();
    for i in 1..points.len().saturating_sub(1) {
        let arrives = points[i] - points[i - 1];
        let leaves = points[i + 1] - points[i];
        let turn_rad = wrap_angle(leaves.yaw_rad() - arrives.yaw_rad());
        if turn_rad.abs() < STRAIGHT_RAD || turn_rad.abs() > SHARPEST_RAD {
            continue;
        }
        let inward = (leaves.normalized() - arrives.normalized()).normalized();
        let rounded = candidates(points[i], inward, turn_rad, widest_m).find(|disc| {
            let sharp = std::mem::replace(&mut discs[i], *disc);
            let fits = fits(mesh, &discs, i);
            discs[i] = sharp;
            fits
        });
        discs[i] = rounded.unwrap_or(discs[i]);
    }
    pieces(&discs)
}

/// The discs worth trying at a corner, the widest first and for each width the fillet before the swing.
fn candidates(corner: Vec2, inward: Vec2, turn_rad: f64, widest_m: f64) -> impl Iterator<Item = Disc> {
    let widths = std::iter::successors(Some(widest_m), |radius_m| Some(radius_m * RADIUS_STEP));
    widths.take_while(|radius_m| *radius_m >= LEAST_RADIUS_M).flat_map(move |radius_m| {
        [radius_m / (0.5 * turn_rad).cos(), radius_m].map(|offset_m| Disc {
            centre: corner + inward * offset_m,
            radius_m,
            side: turn_rad.signum(),
        })
    })
}

/// Whether the line around the discs near the `i`-th one can be drawn and stays on the mesh.
fn fits(mesh: &NavMesh, discs: &[Disc], i: usize) -> bool {
    let first = i.saturating_sub(2);
    let last = (i + 2).min(discs.len() - 1);
    let Some(legs) = (first..last).map(|j| leg(discs[j], discs[j + 1])).collect::<Option<Vec<Leg>>>() else {
        return false;
    };
    let straight = legs.iter().enumerate().filter(|(j, _)| (i.saturating_sub(1)..=i).contains(&(first + j)));
    if !straight.into_iter().all(|(_, leg)| mesh.segment_inside(leg.from, leg.to)) {
        return false;
    }
    (i - 1..=i + 1).filter(|j| discs[*j].radius_m > 0.0).all(|j| {
        let (arrives, leaves) = (legs[j - 1 - first], legs[j - first]);
        let Some(chords) = chords(discs[j], arrives, leaves) else { return false };
        let mut from = arrives.to;
        chords.iter().all(|chord| mesh.segment_inside(std::mem::replace(&mut from, chord.to), chord.to))
    })
}

/// The common tangent that leaves `a` on its side and arrives at `b` on its side.
fn leg(a: Disc, b: Disc) -> Option<Leg> {
    let between = b.centre - a.centre;
    let distance_m = between.length();
    let aside_m = b.side * b.radius_m - a.side * a.radius_m;
    if distance_m <= aside_m.abs() || distance_m < 1.0e-9 {
        return None;
    }
    let yaw_rad = wrap_angle(between.yaw_rad() - (aside_m / distance_m).asin());
    let left = Vec2::from_yaw(yaw_rad).left();
    let from = a.centre - left * (a.side * a.radius_m);
    let to = b.centre - left * (b.side * b.radius_m);
    Some(Leg { from, to, yaw_rad })
}

/// The arc between two legs as chords; `None` when the legs would have it run backwards.
fn chords(disc: Disc, arrives: Leg, leaves: Leg) -> Option<Vec<Piece>> {
    let sweep_rad = disc.side * wrap_angle(leaves.yaw_rad - arrives.yaw_rad);
    if sweep_rad < 0.0 {
        return None;
    }
    let count = (sweep_rad / CHORD_RAD).max(sweep_rad * disc.radius_m / CHORD_M).ceil().max(1.0);
    let yaw_at = |i: f64| arrives.yaw_rad + disc.side * sweep_rad * i / count;
    let chord = |i: usize| {
        let (yaw_start_rad, yaw_end_rad) = (yaw_at(i as f64), yaw_at(i as f64 + 1.0));
        let to = disc.centre - Vec2::from_yaw(yaw_end_rad).left() * (disc.side * disc.radius_m);
        Piece { to, yaw_start_rad, yaw_end_rad }
    };
    let mut chords: Vec<Piece> = (0..count as usize).map(chord).collect();
    chords.last_mut()?.to = leaves.from;
    Some(chords)
}

fn pieces(discs: &[Disc]) -> Vec<Piece> {
    let legs: Vec<Leg> = discs.windows(2).filter_map(|pair| leg(pair[0], pair[1])).collect();
    let mut pieces = Vec::new();
    for (i, straight) in legs.iter().enumerate() {
        pieces.push(Piece { to: straight.to, yaw_start_rad: straight.yaw_rad, yaw_end_rad: straight.yaw_rad });
        if let (true, Some(next)) = (discs[i + 1].radius_m > 0.0, legs.get(i + 1)) {
            pieces.extend(chords(discs[i + 1], *straight, *next).unwrap_or_default());
        }
    }
    pieces
}

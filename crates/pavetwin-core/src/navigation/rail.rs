//! A path made flyable: round corners, a tangent everywhere, and a speed limit that can always be kept.

use super::corners::{self, Piece};
use super::error::NavMeshError;
use super::mesh::NavMesh;
use crate::geometry::{Vec2, wrap_angle};

/// A bend sharper than this is flown at rest: stop, turn, go on.
const SHARP_RAD: f64 = 1.0 * std::f64::consts::PI / 180.0;
/// Points nearer to each other than this, in metres, are one point.
const SAME_POINT_M: f64 = 1.0e-6;

/// What the airframe can do, in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Cruise speed, in m/s.
    pub speed_mps: f64,
    /// Acceleration, braking and centripetal acceleration, in m/s².
    pub acceleration_mps2: f64,
    /// Angular speed about the vertical, in rad/s.
    pub yaw_rate_rad_s: f64,
    /// Highest speed through the air, in m/s; infinite for an airframe that the wind does not slow down.
    pub airspeed_mps: f64,
    /// Velocity of the air over the ground, in m/s.
    pub wind: Vec2,
}

/// A line to fly along, with the tangent (`yaw_rad`) and the speed limit at every distance `s` from its start.
///
/// Arcs are held as short chords, each checked against the mesh: every position of a rail lies on the mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Rail {
    points: Vec<Vec2>,
    /// The distance of each point from the start, in metres.
    distances_m: Vec<f64>,
    /// The tangent at the start and the end of the piece that follows each point but the last.
    yaws_rad: Vec<[f64; 2]>,
    /// The square of the speed limit at each point, in m²/s².
    limits: Vec<f64>,
    /// The square of the speed limit on the piece that follows each point but the last.
    caps: Vec<f64>,
    /// The points at which the agent comes to rest: sharp corners, and the end.
    stops: Vec<usize>,
    acceleration_mps2: f64,
    made_for: Limits,
}

impl Rail {
    /// Makes a path flyable. `points` are the corners, both ends included; repeated points are taken once, and points
    /// that miss the mesh by less than a millimetre are moved onto it.
    ///
    /// At every corner the largest arc is taken for which the line stays on the mesh, up to the radius at which the
    /// cruise speed can be kept. The speed on an arc of radius r is at most √(a·r) and yaw rate · r.
    ///
    /// # Errors
    /// [`NavMeshError::Empty`] without points, [`NavMeshError::StartOutside`] and [`NavMeshError::LeavesMesh`] when a
    /// point or a straight piece is outside the mesh, [`NavMeshError::BadConfig`] when a limit is not positive.
    pub fn new(mesh: &NavMesh, points: &[Vec2], limits: &Limits) -> Result<Self, NavMeshError> {
        limits.check()?;
        let mut corners: Vec<Vec2> = Vec::with_capacity(points.len());
        for point in points {
            let place = mesh.snapped(*point).ok_or_else(|| match corners.last() {
                None => NavMeshError::StartOutside { x: point.x, y: point.y },
                Some(from) => NavMeshError::LeavesMesh { from: *from, to: *point },
            })?;
            if corners.last().is_none_or(|last| last.distance(place) > SAME_POINT_M) {
                corners.push(place);
            }
        }
        if let Some(leg) = corners.windows(2).find(|leg| !mesh.segment_inside(leg[0], leg[1])) {
            return Err(NavMeshError::LeavesMesh { from: leg[0], to: leg[1] });
        }
        let start = *corners.first().ok_or(NavMeshError::Empty)?;
        let widest_m = (limits.speed_mps / limits.yaw_rate_rad_s)
            .max(limits.speed_mps * limits.speed_mps / limits.acceleration_mps2);
        Ok(Self::of_pieces(start, &corners::round(mesh, &corners, widest_m), *limits))
    }

    fn of_pieces(start: Vec2, pieces: &[Piece], limits: Limits) -> Self {
        let mut rail = Self {
            points: vec![start],
            distances_m: vec![0.0],
            yaws_rad: Vec::new(),
            limits: Vec::new(),
            caps: Vec::new(),
            stops: Vec::new(),
            acceleration_mps2: limits.acceleration_mps2,
            made_for: limits,
        };
        for piece in pieces {
            let from = rail.points[rail.points.len() - 1];
            let length_m = from.distance(piece.to);
            if length_m < 1.0e-9 {
                continue;
            }
            let bend_rad = wrap_angle(piece.yaw_end_rad - piece.yaw_start_rad).abs();
            let speed_mps = limits.speed_towards(piece.yaw_start_rad).min(limits.speed_towards(piece.yaw_end_rad));
            let cap_mps = if bend_rad > 0.0 {
                let radius_m = length_m / bend_rad;
                speed_mps.min(limits.yaw_rate_rad_s * radius_m).min((limits.acceleration_mps2 * radius_m).sqrt())
            } else {
                speed_mps
            };
            rail.points.push(piece.to);
            rail.distances_m.push(rail.length_m() + length_m);
            rail.yaws_rad.push([piece.yaw_start_rad, piece.yaw_end_rad]);
            rail.caps.push(cap_mps * cap_mps);
        }
        rail.limit_speed();
        rail
    }

    /// Fills in the limits at the points: the pieces' own, zero at stops, and what acceleration leaves of them.
    fn limit_speed(&mut self) {
        let last = self.points.len() - 1;
        self.limits = vec![f64::INFINITY; last + 1];
        for i in 0..=last {
            let before = i.checked_sub(1).map(|i| self.caps[i]).unwrap_or(f64::INFINITY);
            let after = self.caps.get(i).copied().unwrap_or(0.0);
            self.limits[i] = before.min(after);
            let sharp =
                i > 0 && i < last && wrap_angle(self.yaws_rad[i][0] - self.yaws_rad[i - 1][1]).abs() > SHARP_RAD;
            if sharp || i == last {
                self.limits[i] = 0.0;
                self.stops.push(i);
            }
        }
        let gain = |from: usize| 2.0 * self.acceleration_mps2 * (self.distances_m[from + 1] - self.distances_m[from]);
        for i in (0..last).rev() {
            self.limits[i] = self.limits[i].min(self.limits[i + 1] + gain(i));
        }
        for i in 0..last {
            self.limits[i + 1] = self.limits[i + 1].min(self.limits[i] + gain(i));
        }
    }

    /// The length, in metres.
    pub fn length_m(&self) -> f64 {
        self.distances_m[self.distances_m.len() - 1]
    }

    /// The points of the line, arcs as chords, for drawing.
    pub fn points(&self) -> &[Vec2] {
        &self.points
    }

    /// The limits the rail was made for.
    pub fn limits(&self) -> Limits {
        self.made_for
    }

    /// The tangent at the start, `None` on a rail without length.
    pub fn initial_yaw_rad(&self) -> Option<f64> {
        self.yaws_rad.first().map(|yaws| wrap_angle(yaws[0]))
    }

    /// The position and the tangent at `s_m` metres from the start (clamped to the rail). At a sharp corner the tangent
    /// is the one that arrives. A rail without length points east.
    pub fn sample(&self, s_m: f64) -> (Vec2, f64) {
        let piece = self.piece_at(s_m);
        self.sample_on(piece, s_m)
    }

    /// The highest speed at `s_m` metres from the start, in m/s, from which every later limit can still be kept.
    pub fn speed_limit(&self, s_m: f64) -> f64 {
        self.limit_on(self.piece_at(s_m), s_m).max(0.0).sqrt()
    }

    /// The distances from the start at which the agent comes to rest, in metres; the end is the last.
    pub fn stops_m(&self) -> impl Iterator<Item = f64> + '_ {
        self.stops.iter().map(|stop| self.distances_m[*stop])
    }

    /// The first stop that ends a piece from `piece` on, as a point's number.
    pub(super) fn stop_after(&self, piece: usize) -> usize {
        self.stops.iter().copied().find(|stop| *stop > piece).unwrap_or(self.points.len() - 1)
    }

    pub(super) fn distance_at(&self, point: usize) -> f64 {
        self.distances_m[point]
    }

    pub(super) fn yaw_after(&self, point: usize) -> Option<f64> {
        self.yaws_rad.get(point).map(|yaws| wrap_angle(yaws[0]))
    }

    /// The piece that holds `s_m`, found from a piece at or before it.
    pub(super) fn piece_from(&self, mut piece: usize, s_m: f64) -> usize {
        while piece + 2 < self.points.len() && self.distances_m[piece + 1] < s_m {
            piece += 1;
        }
        piece
    }

    fn piece_at(&self, s_m: f64) -> usize {
        let after = self.distances_m.partition_point(|distance_m| *distance_m < s_m);
        after.saturating_sub(1).min(self.points.len().saturating_sub(2))
    }

    pub(super) fn sample_on(&self, piece: usize, s_m: f64) -> (Vec2, f64) {
        let Some(yaws) = self.yaws_rad.get(piece) else { return (self.points[0], 0.0) };
        let (from_m, to_m) = (self.distances_m[piece], self.distances_m[piece + 1]);
        let share = ((s_m - from_m) / (to_m - from_m)).clamp(0.0, 1.0);
        let position = self.points[piece].lerp(self.points[piece + 1], share);
        (position, wrap_angle(yaws[0] + wrap_angle(yaws[1] - yaws[0]) * share))
    }

    /// The square of the speed limit at `s_m`, which lies on `piece`.
    pub(super) fn limit_on(&self, piece: usize, s_m: f64) -> f64 {
        let Some(cap) = self.caps.get(piece) else { return 0.0 };
        let (from_m, to_m) = (self.distances_m[piece], self.distances_m[piece + 1]);
        let s_m = s_m.clamp(from_m, to_m);
        let rising = self.limits[piece] + 2.0 * self.acceleration_mps2 * (s_m - from_m);
        let falling = self.limits[piece + 1] + 2.0 * self.acceleration_mps2 * (to_m - s_m);
        cap.min(rising).min(falling)
    }
}

impl Limits {
    /// Whether the numbers describe an airframe.
    ///
    /// # Errors
    /// [`NavMeshError::BadConfig`] for the first that is not above zero, or when the wind is faster than the airspeed.
    pub fn check(&self) -> Result<(), NavMeshError> {
        let wind_mps = self.wind.length();
        if !(wind_mps.is_finite() && self.airspeed_mps > wind_mps) {
            return Err(NavMeshError::BadConfig {
                what: format!("airspeed_mps is {} in a wind of {wind_mps} m/s", self.airspeed_mps),
                hint: "give an airspeed above the wind's speed",
            });
        }
        let named = [
            ("speed_mps", self.speed_mps),
            ("acceleration_mps2", self.acceleration_mps2),
            ("yaw_rate_rad_s", self.yaw_rate_rad_s),
        ];
        match named.into_iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            None => Ok(()),
            Some((name, value)) => Err(NavMeshError::BadConfig {
                what: format!("{name} is {value}"),
                hint: "give a finite number above zero",
            }),
        }
    }

    /// The highest ground speed towards a yaw: the cruise speed, or less where the wind leaves less of the airspeed.
    pub fn speed_towards(&self, yaw_rad: f64) -> f64 {
        if self.airspeed_mps == f64::INFINITY {
            return self.speed_mps;
        }
        let along = Vec2::from_yaw(yaw_rad);
        let (with, across) = (self.wind.dot(along), self.wind.cross(along));
        self.speed_mps.min(with + (self.airspeed_mps * self.airspeed_mps - across * across).sqrt())
    }

    /// The highest ground speed straight against the wind.
    pub fn least_speed_mps(&self) -> f64 {
        self.speed_mps.min(self.airspeed_mps - self.wind.length())
    }
}

//! Ground that is not flat: heights over a frame's plane, from all hits that the beams have swept
//! up along the track.
//!
//! ```text
//! p(t) = ∫ q · v dt                       the instrument's way: its velocity over the ground v, turned by the attitude q
//! h_i = d − n · hit_i                     height of a hit over the frame's plane n·x = d, towards the vehicle
//! h(x) = Σ_i a_i k(|x − x_i|),  (K + σ²) a = h      Gaussian process, zero mean: the plane, wherever no hit is near
//! ```
//!
//! Hits of seconds before and after fall into place around a frame, so ridges along the way are
//! seen before they are passed. An instrument with many beams (a depth picture, a cloud) needs no
//! way: one ping is a surface. Whether heights are used at all is decided once for a log: by how
//! well they foretell hits that were left out. In: pings with velocities, attitude, a plane. Out:
//! heights [m] on a grid in the plane.

use nalgebra::{DMatrix, DVector, Vector3};

use super::SeafloorPlane;
use super::ping_store::PingStore;
use crate::coordinates::{Body, Point};
use crate::units::Stamp;
use crate::vehicle::{AttitudeTrack, Ping, Rig};

/// Hits farther along the track lie outside the picture, and drift takes their place away [s].
const WINDOW_S: f64 = 12.0;
/// Hits this far from below the camera, in altitudes.
const REACH: f64 = 2.0;
/// How far a hit speaks for the ground around it, in altitudes.
const LENGTH: f64 = 0.3;
/// A range's noise as a share of the altitude, what it is at least [m], and what a height loses per
/// second of way [m/s].
const NOISE_SHARE: f64 = 0.006;
const LEAST_NOISE_M: f64 = 0.005;
const DRIFT_M_PER_S: f64 = 0.003;
/// More hits cost time and tell no more.
const MOST_HITS: usize = 140;
/// A single ping of this many returns is a surface by itself.
const MANY_RETURNS: usize = 9;
/// Nodes per axis of the grid that heights are looked up in.
const NODES: usize = 33;
/// Pings are joined to a way over no longer gap [s].
const LONGEST_GAP_S: f64 = 1.0;
/// Hits are foretold from those that many seconds away or more.
const APART_S: f64 = 0.6;
/// Heights are used where they foretell left-out hits with this share of the plane's misfit at
/// most.
const LEAST_BETTER: f64 = 0.75;
/// Rays are followed to the surface in so many steps; slopes are gentle.
const STEPS: usize = 4;

/// The instrument's way over the ground: per ping the stretch it belongs to and its place in the
/// world [m].
#[derive(Clone, Debug, Default)]
pub struct Way(Vec<(u32, Vector3<f64>)>);

impl Way {
    /// Adds up the pings' velocities; a new stretch begins wherever one is missing.
    pub fn of(pings: &PingStore, attitude: &AttitudeTrack, rig: &Rig) -> Self {
        let velocity = |p: &Ping| {
            Some(
                attitude.world_from_body(p.stamp)?
                    * (rig.body_from_dvl.isometry().rotation * p.velocity_m_per_s?),
            )
        };
        let (mut stretch, mut place) = (0, Vector3::zeros());
        let mut before: Option<(Stamp, Vector3<f64>)> = None;
        let mut way = Vec::with_capacity(pings.len());
        for ping in pings.iter() {
            let now = velocity(&ping);
            match (before, now) {
                (Some((stamp, v)), Some(now))
                    if ping.stamp.seconds_since(stamp) <= LONGEST_GAP_S =>
                {
                    place += (v + now) / 2.0 * ping.stamp.seconds_since(stamp);
                }
                _ => stretch += 1,
            }
            before = now.map(|v| (ping.stamp, v));
            way.push((stretch, place));
        }
        Self(way)
    }

    /// The place at a moment between two pings of one stretch.
    pub fn at(&self, pings: &PingStore, stamp: Stamp) -> Option<(u32, Vector3<f64>)> {
        let after = pings.before(Stamp(stamp.0.saturating_add(1))).min(pings.len().checked_sub(1)?);
        let (a, b) = (after.checked_sub(1)?, after);
        if pings.stamp(b) < stamp {
            return None;
        }
        let (first, second) = (self.0.get(a)?, self.0.get(b)?);
        let span = pings.stamp(b).seconds_since(pings.stamp(a));
        let share = if span > 0.0 { stamp.seconds_since(pings.stamp(a)) / span } else { 0.0 };
        (first.0 == second.0).then(|| (first.0, first.1.lerp(&second.1, share)))
    }
}

/// A hit over the plane: u, v, height [m], seconds from the frame, and which ping's which beam it
/// was.
#[derive(Clone, Copy, Debug)]
pub struct Height {
    ping: usize,
    beam: usize,
    u: f64,
    v: f64,
    height_m: f64,
    offset_s: f64,
}

/// Axes in a plane: origin below the camera.
#[derive(Clone, Copy, Debug)]
struct Axes {
    origin: Vector3<f64>,
    u: Vector3<f64>,
    v: Vector3<f64>,
    altitude_m: f64,
}

impl Axes {
    fn of(plane: &SeafloorPlane, rig: &Rig) -> Self {
        let (normal, camera) = (plane.normal.vector(), rig.body_from_optical.origin().vector());
        let altitude_m = plane.distance_m - normal.dot(&camera);
        let u = normal
            .cross(&if normal.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() })
            .normalize();
        Self { origin: camera + normal * altitude_m, u, v: normal.cross(&u), altitude_m }
    }

    fn of_point(&self, at: &Vector3<f64>) -> (f64, f64) {
        let from = at - self.origin;
        (self.u.dot(&from), self.v.dot(&from))
    }
}

/// Heights over a frame's plane.
#[derive(Clone, Debug)]
pub struct Terrain {
    axes: Axes,
    /// nodes, v major: height [m] and its slopes along u and v
    nodes: Vec<[f64; 3]>,
    half_side_m: f64,
}

/// All hits around a moment, as heights over its plane.
pub fn heights(
    pings: &PingStore,
    way: &Way,
    attitude: &AttitudeTrack,
    stamp: Stamp,
    plane: &SeafloorPlane,
    rig: &Rig,
) -> Vec<Height> {
    let axes = Axes::of(plane, rig);
    let instrument = rig.body_from_dvl.origin().vector();
    let (first, last) =
        (pings.before(stamp.plus_seconds(-WINDOW_S)), pings.before(stamp.plus_seconds(WINDOW_S)));
    let here = way.at(pings, stamp);
    let nearest = (first..last).filter(|i| pings.returns(*i) >= MANY_RETURNS).min_by(|a, b| {
        let gap = |i: usize| pings.stamp(i).seconds_since(stamp).abs();
        gap(*a).total_cmp(&gap(*b))
    });
    let mut found = Vec::new();
    for i in first..last {
        let ping = pings.get(i);
        let moved = match (here, way.0.get(i)) {
            (Some((stretch, place)), Some((s, p))) if *s == stretch => {
                attitude.world_from_body(stamp).map(|q| q.inverse() * (p - place))
            }
            _ if Some(i) == nearest => Some(Vector3::zeros()),
            _ => None,
        };
        let turn = attitude
            .rotation_between(stamp, ping.stamp)
            .or_else(|| (Some(i) == nearest).then(Default::default));
        let (Some(moved), Some(turn)) = (moved, turn) else { continue };
        for (b, beam) in ping.beams.iter().enumerate() {
            let Some(range) = beam.range else { continue };
            let at = instrument
                + moved
                + turn * ((rig.body_from_dvl * beam.direction).vector() * range.0);
            let ((u, v), height_m) =
                (axes.of_point(&at), plane.distance_m - plane.normal.vector().dot(&at));
            if u.hypot(v) < REACH * axes.altitude_m && height_m.abs() < axes.altitude_m / 2.0 {
                found.push(Height {
                    ping: i,
                    beam: b,
                    u,
                    v,
                    height_m,
                    offset_s: ping.stamp.seconds_since(stamp),
                });
            }
        }
    }
    found
}

/// As many hits as tell something, by turns among the beams: each of them is left with as many.
fn thinned(hits: Vec<Height>) -> Vec<Height> {
    let every = hits.len().div_ceil(MOST_HITS).max(1);
    hits.into_iter().filter(|h| (h.ping + h.beam) % every == 0).collect()
}

/// A Gaussian process over hits.
struct Process {
    hits: Vec<Height>,
    weights: DVector<f64>,
    length_m: f64,
}

impl Process {
    fn new(hits: Vec<Height>, altitude_m: f64) -> Option<Self> {
        let n = hits.len();
        let spread = hits.iter().map(|h| h.height_m * h.height_m).sum::<f64>() / n.max(1) as f64;
        let noise = |h: &Height| {
            (NOISE_SHARE * altitude_m + LEAST_NOISE_M).powi(2)
                + (DRIFT_M_PER_S * h.offset_s).powi(2)
        };
        let length_m = LENGTH * altitude_m;
        let kernel = |a: &Height, b: &Height| {
            spread
                * (-((a.u - b.u).powi(2) + (a.v - b.v).powi(2)) / (2.0 * length_m * length_m)).exp()
        };
        let matrix = DMatrix::from_fn(n, n, |i, j| {
            kernel(&hits[i], &hits[j]) + if i == j { noise(&hits[i]) } else { 0.0 }
        });
        let weights =
            matrix.cholesky()?.solve(&DVector::from_iterator(n, hits.iter().map(|h| h.height_m)))
                * spread;
        Some(Self { hits, weights, length_m })
    }

    /// Height and slopes.
    fn at(&self, u: f64, v: f64) -> [f64; 3] {
        let per_square = 1.0 / (self.length_m * self.length_m);
        self.hits.iter().zip(self.weights.iter()).fold([0.0; 3], |[h, du, dv], (hit, w)| {
            let (x, y) = (u - hit.u, v - hit.v);
            let k = w * (-(x * x + y * y) * per_square / 2.0).exp();
            [h + k, du - k * x * per_square, dv - k * y * per_square]
        })
    }
}

impl Terrain {
    /// Heights from hits; `None` where there are too few.
    pub fn new(hits: Vec<Height>, plane: &SeafloorPlane, rig: &Rig) -> Option<Self> {
        if hits.len() < MANY_RETURNS {
            return None;
        }
        let axes = Axes::of(plane, rig);
        let process = Process::new(thinned(hits), axes.altitude_m)?;
        let half_side_m = REACH * axes.altitude_m;
        let place = |i: usize| (2.0 * i as f64 / (NODES - 1) as f64 - 1.0) * half_side_m;
        let nodes =
            (0..NODES * NODES).map(|i| process.at(place(i % NODES), place(i / NODES))).collect();
        Some(Self { axes, nodes, half_side_m })
    }

    /// Height and slopes along the axes below a place; the plane's beyond the grid.
    fn at(&self, at: &Vector3<f64>) -> [f64; 3] {
        let (u, v) = self.axes.of_point(at);
        let [x, y] = [u, v].map(|p| (p / self.half_side_m + 1.0) / 2.0 * (NODES - 1) as f64);
        let inside = |p: f64| p >= 0.0 && p < (NODES - 1) as f64;
        if !inside(x) || !inside(y) {
            return [0.0; 3];
        }
        let (i, j) = (x as usize, y as usize);
        let (a, b) = (x - i as f64, y - j as f64);
        let node = |i: usize, j: usize| &self.nodes[j * NODES + i];
        std::array::from_fn(|k| {
            (1.0 - b) * ((1.0 - a) * node(i, j)[k] + a * node(i + 1, j)[k])
                + b * ((1.0 - a) * node(i, j + 1)[k] + a * node(i + 1, j + 1)[k])
        })
    }

    /// Where a ray from `camera` meets the surface: the place, its distance, and the surface's
    /// normal (not of unit length).
    pub fn meet(
        &self,
        plane: &SeafloorPlane,
        camera: &Vector3<f64>,
        ray: &Vector3<f64>,
    ) -> Option<(Point<Body>, f64, Vector3<f64>)> {
        let normal = plane.normal.vector();
        let (towards, depth) = (normal.dot(ray), plane.distance_m - normal.dot(camera));
        let mut distance = depth / towards;
        let mut here = [0.0; 3];
        for _ in 0..STEPS {
            here = self.at(&(camera + ray * distance));
            distance = (depth - here[0]) / towards;
        }
        let surface = normal + self.axes.u * here[1] + self.axes.v * here[2];
        (distance > 0.0 && surface.dot(ray) > 0.0)
            .then(|| (Point::from_vector(camera + ray * distance), distance, surface))
    }
}

/// How well hits are foretold by the others, over the plane's own misfit, over some frames: 1 says
/// that heights tell nothing. `None` where there are too few.
pub fn foretold(frames: impl Iterator<Item = (Vec<Height>, f64)>) -> Option<f64> {
    let (mut by_plane, mut by_relief) = (Vec::new(), Vec::new());
    for (hits, altitude_m) in frames {
        // Nearby in time is nearby in place: hits are left out by the second, with a margin.
        for second in [-4.0, -2.0, 0.0, 2.0, 4.0] {
            let others: Vec<Height> = hits
                .iter()
                .filter(|h| (h.offset_s - second).abs() > 0.5 + APART_S)
                .copied()
                .collect();
            if others.len() < MANY_RETURNS {
                continue;
            }
            let Some(process) = Process::new(thinned(others), altitude_m) else { continue };
            let left_out: Vec<Height> =
                hits.iter().filter(|h| (h.offset_s - second).abs() <= 0.5).copied().collect();
            // Beams of one ping against each other: what the way has wrong (a climb not told in
            // full) lifts them all alike and is no relief.
            for of_ping in left_out.chunk_by(|a, b| a.ping == b.ping).filter(|p| p.len() >= 2) {
                let foretold: Vec<f64> =
                    of_ping.iter().map(|h| h.height_m - process.at(h.u, h.v)[0]).collect();
                let mean = |values: &mut dyn Iterator<Item = f64>| {
                    values.sum::<f64>() / of_ping.len() as f64
                };
                let (plane, relief) = (
                    mean(&mut of_ping.iter().map(|h| h.height_m)),
                    mean(&mut foretold.iter().copied()),
                );
                by_plane.extend(of_ping.iter().map(|h| (h.height_m - plane).abs()));
                by_relief.extend(foretold.iter().map(|e| (e - relief).abs()));
            }
        }
    }
    let median = |values: &mut Vec<f64>| {
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    (by_plane.len() >= 50).then(|| median(&mut by_relief) / median(&mut by_plane).max(1e-9))
}

/// Whether that is good enough.
pub fn is_worth_it(foretold: f64) -> bool {
    foretold < LEAST_BETTER
}

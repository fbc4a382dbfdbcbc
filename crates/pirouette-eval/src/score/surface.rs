//! Distance between two surfaces.

use glam::{DMat3, DVec3};
use pirouette_geom::TriMesh;
use pirouette_geom::nearest::NearestSurface;
use pirouette_synthetic::Random;
use rayon::prelude::*;

use crate::table::{mean, percentile};

/// Number of points sampled on each body for distances
const SAMPLE_COUNT: usize = 20_000;

/// The alignment uses every n-th of them
const ALIGN_STEP: usize = 2;

/// Maximum number of rounds of the alignment
const ROUNDS: usize = 30;

/// Share of the points used by the alignment; the farthest ones are errors of the shape
const FOLLOWED: f64 = 0.85;

/// The alignment ends when a round moves points by less than this, in mm
const SETTLED_MM: f64 = 1e-3;

/// Distance between two bodies after a shift and a turn about the vertical
#[derive(Debug, Clone)]
pub struct SurfaceError {
    /// Mean distance from points of one to the other, mean of both directions, in mm
    pub mean_mm: f64,
    /// The larger of the 95th percentiles of both directions, in mm
    pub p95_mm: f64,
    /// Points of the true body: the triangle that each lies on, and the distance to the other body, in mm
    pub from_truth: Vec<(usize, f64)>,
}

/// Compares a body with the true one; `None` if one has no surface
///
/// Both are put on the floor first; then sampled points of the body are aligned with their nearest sampled points of
/// the true body, by shifts and by turns about the vertical. (With nearest points of the triangles, the bodies slide
/// along each other so slowly that hundreds of rounds do not converge.)
///
/// # Source
/// P. Besl, N. McKay 1992, "A method for registration of 3-D shapes", trimmed.
pub fn surface_error(body: &TriMesh, truth: &TriMesh) -> Option<SurfaceError> {
    let aligned = Aligned::new(body, truth)?;
    let (samples, true_samples) = (&aligned.samples, &aligned.true_samples);
    let still = NearestSurface::new(&aligned.truth);
    let moved = NearestSurface::new(&aligned.body);
    let to_truth: Vec<f64> = samples
        .par_iter()
        .filter_map(|p| Some(still.nearest(*p)?.distance))
        .collect();
    let from_truth: Vec<(usize, f64)> = true_samples
        .par_iter()
        .filter_map(|(triangle, p)| Some((*triangle, moved.nearest(*p)?.distance)))
        .collect();
    let back: Vec<f64> = from_truth.iter().map(|(_, distance)| *distance).collect();
    Some(SurfaceError {
        mean_mm: (mean(&to_truth)? + mean(&back)?) / 2.0,
        p95_mm: percentile(&to_truth, 0.95)?.max(percentile(&back, 0.95)?),
        from_truth,
    })
}

/// Two bodies, aligned by a shift and a turn about the vertical
pub(crate) struct Aligned {
    pub(crate) body: TriMesh,
    pub(crate) truth: TriMesh,
    /// Points on the body
    samples: Vec<DVec3>,
    /// Points on the true body, with their triangles
    true_samples: Vec<(usize, DVec3)>,
}

impl Aligned {
    /// Aligns two bodies; `None` if one has no surface
    pub(crate) fn new(body: &TriMesh, truth: &TriMesh) -> Option<Self> {
        let (body, truth) = (on_the_floor(body)?, on_the_floor(truth)?);
        let (samples, true_samples) = (sample(&body, 1), sample(&truth, 2));
        let motion = best_motion(&body, &samples, &true_samples)?;
        Some(Self {
            body: TriMesh {
                positions: body.positions.iter().map(|p| motion.carry(*p)).collect(),
                triangles: body.triangles,
            },
            truth,
            samples: samples.iter().map(|(_, p)| motion.carry(*p)).collect(),
            true_samples,
        })
    }
}

fn best_motion(
    body: &TriMesh,
    samples: &[(usize, DVec3)],
    true_samples: &[(usize, DVec3)],
) -> Option<Motion> {
    let mut motion = Motion::default();
    let followers: Vec<DVec3> = samples.iter().step_by(ALIGN_STEP).map(|s| s.1).collect();
    let leaders = points_only(true_samples);
    for _ in 0..ROUNDS {
        let step = align_step(&followers, &motion, &leaders)?;
        motion = step.after(&motion);
        let settled = step.shift.length() + step.angle.abs() * body.bounds()?.1.y;
        if settled < SETTLED_MM {
            break;
        }
    }
    Some(motion)
}

/// Returns the mesh without unused vertices, with its lowest point at y = 0; `None` if its area is zero
fn on_the_floor(mesh: &TriMesh) -> Option<TriMesh> {
    let used = || mesh.triangles.iter().flatten();
    let low = used()
        .filter_map(|&v| mesh.positions.get(v as usize))
        .map(|p| p.y)
        .min_by(f64::total_cmp)?;
    let high = used().copied().max()? as usize;
    if high >= mesh.positions.len() || !low.is_finite() {
        return None;
    }
    let mesh = TriMesh {
        positions: mesh.positions.iter().map(|p| *p - DVec3::Y * low).collect(),
        triangles: mesh.triangles.clone(),
    };
    let area = mesh.area();
    (area > 0.0 && area.is_finite()).then_some(mesh)
}

/// Samples points on the surface, with their triangles: equal shares of the area, with a random point in each
fn sample(mesh: &TriMesh, seed: u64) -> Vec<(usize, DVec3)> {
    let mut random = Random::new(seed);
    let share = mesh.area() / SAMPLE_COUNT as f64;
    let mut samples = Vec::with_capacity(SAMPLE_COUNT);
    let (mut passed, mut next) = (0.0, share * random.uniform());
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(t);
        passed += (b - a).cross(c - a).length() / 2.0;
        while next < passed && samples.len() < SAMPLE_COUNT {
            let (s, t_) = (random.uniform(), random.uniform());
            let (s, t_) = if s + t_ > 1.0 {
                (1.0 - s, 1.0 - t_)
            } else {
                (s, t_)
            };
            samples.push((t, a + (b - a) * s + (c - a) * t_));
            next = share * (samples.len() as f64 + random.uniform());
        }
    }
    samples
}

/// Builds a surface of points, each a triangle of zero area
fn points_only(samples: &[(usize, DVec3)]) -> NearestSurface {
    NearestSurface::new(&TriMesh {
        positions: samples.iter().map(|(_, p)| *p).collect(),
        triangles: (0..samples.len() as u32).map(|v| [v; 3]).collect(),
    })
}

/// A turn about the y axis, followed by a shift
#[derive(Debug, Clone, Copy, Default)]
struct Motion {
    angle: f64,
    shift: DVec3,
}

impl Motion {
    fn carry(&self, point: DVec3) -> DVec3 {
        DMat3::from_rotation_y(self.angle) * point + self.shift
    }

    fn after(&self, first: &Motion) -> Motion {
        Motion {
            angle: self.angle + first.angle,
            shift: self.carry(first.shift),
        }
    }
}

/// Computes the motion that minimizes the distances of moved points to their nearest points of the true body
fn align_step(points: &[DVec3], motion: &Motion, leaders: &NearestSurface) -> Option<Motion> {
    let pairs: Vec<(DVec3, DVec3, f64)> = points
        .par_iter()
        .filter_map(|p| {
            let moved = motion.carry(*p);
            let found = leaders.nearest(moved)?;
            Some((moved, found.position, found.distance))
        })
        .collect();
    let distances: Vec<f64> = pairs.iter().map(|pair| pair.2).collect();
    let limit = percentile(&distances, FOLLOWED)?;
    let followed = || pairs.iter().filter(|pair| pair.2 <= limit);
    let count = followed().count() as f64;
    let from = followed().map(|pair| pair.0).sum::<DVec3>() / count;
    let to = followed().map(|pair| pair.1).sum::<DVec3>() / count;
    let (mut cos, mut sin) = (0.0, 0.0);
    for (x, y, _) in followed() {
        let (x, y) = (*x - from, *y - to);
        cos += x.x * y.x + x.z * y.z;
        sin += x.z * y.x - x.x * y.z;
    }
    let angle = sin.atan2(cos);
    Some(Motion {
        angle,
        shift: to - DMat3::from_rotation_y(angle) * from,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    fn figure() -> TriMesh {
        mannequin(&MannequinParameters::default()).unwrap().mesh
    }

    #[test]
    fn a_turned_and_moved_body_has_no_error() {
        let truth = figure();
        let motion = Motion {
            angle: 0.15,
            shift: DVec3::new(20.0, 300.0, -35.0),
        };
        let body = TriMesh {
            positions: truth.positions.iter().map(|p| motion.carry(*p)).collect(),
            ..truth.clone()
        };
        let error = surface_error(&body, &truth).unwrap();
        assert!(error.mean_mm < 0.3, "{}", error.mean_mm);
    }

    #[test]
    fn a_body_inflated_by_four_millimeters_has_an_error_of_four_millimeters() {
        let truth = figure();
        let normals = truth.vertex_normals();
        let moved = truth
            .positions
            .iter()
            .zip(normals)
            .map(|(p, n)| *p + n * 4.0);
        let body = TriMesh {
            positions: moved.collect(),
            ..truth.clone()
        };
        let error = surface_error(&body, &truth).unwrap();
        assert!((error.mean_mm - 4.0).abs() < 0.5, "{}", error.mean_mm);
        assert!(error.p95_mm > 3.9);
        assert!(
            error
                .from_truth
                .iter()
                .all(|(t, _)| *t < truth.triangles.len())
        );
    }

    #[test]
    fn samples_are_spread_evenly_over_the_area() {
        let mesh = TriMesh {
            positions: vec![
                DVec3::ZERO,
                DVec3::X * 3.0,
                DVec3::Y,
                DVec3::new(-1.0, 0.0, 0.0),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        let samples = sample(&mesh, 1);
        assert!(samples.len().abs_diff(SAMPLE_COUNT) <= 1);
        let first = samples.iter().filter(|(t, _)| *t == 0).count() as f64;
        assert!((first / samples.len() as f64 - 0.75).abs() < 1e-3);
    }

    #[test]
    fn an_empty_surface_has_no_distance() {
        assert!(surface_error(&TriMesh::default(), &figure()).is_none());
        assert!(surface_error(&figure(), &TriMesh::default()).is_none());
    }
}

//! Girths from support lines: the tape in one plane estimated from the outlines of all views.
//!
//! Where a line of sight grazes the body, the plane through it along the outline touches the body; its trace in the
//! plane of a tape is a line that the tape touches. Such a *support line* has a distance `h` from an axis inside and a
//! normal at the angle `theta`. By Cauchy's formula the length of the tape is the integral of `h` over all angles, `2
//! pi` times its mean, and the mean follows from a Fourier series fitted to few angles, evenly spaced or not. A hull
//! carved from the same silhouettes would be longer, because its corners protrude.
//!
//! # Source
//! Cauchy's formula for the perimeter of a convex curve: the integral of the support function over all directions.

use std::f64::consts::{PI, TAU};

use faer::linalg::solvers::Solve;
use glam::{DAffine3, DVec2, DVec3};
use pirouette_geom::{Grid, distance_map::bilinear};

use super::tape::Tape;
use pirouette_body::{Bone, Camera, PosedBones};
use pirouette_geom::outline_map::OutlineMap;

/// A view prepared for tapes
pub(super) struct SeenView<'a> {
    outline: &'a OutlineMap,
    /// Coverage of the photo by the avatar and the offset of its first pixel: assigns outlines to parts
    expected: Grid<f32>,
    corner: DVec2,
    camera: Camera,
    /// The bones of the avatar in the pose of this view
    posed: PosedBones,
}

impl<'a> SeenView<'a> {
    /// `expected` is the avatar's coverage of the same photo
    pub(super) fn new(
        outline: &'a OutlineMap,
        camera: Camera,
        posed: PosedBones,
        expected: &Grid<f32>,
    ) -> Self {
        let (expected, corner) = framed(expected);
        Self {
            outline,
            expected,
            corner,
            camera,
            posed,
        }
    }

    /// Returns the direction of the line of sight seen from above, in radians from 0 to pi; equal for opposite views
    pub(super) fn line_of_sight(&self) -> f64 {
        let direction = self.posed.transforms[Bone::Root].matrix3.transpose() * DVec3::Z;
        direction.x.atan2(direction.z).rem_euclid(PI)
    }

    fn sight(&self, tape: &Tape) -> Sight<'_> {
        let room_from_tape = tape.room_from_reference(&self.posed);
        Sight {
            view: self,
            room_from_tape,
            tape_from_room: room_from_tape.inverse(),
        }
    }
}

/// Crops a picture to its nonzero part with a margin of one pixel, and returns the corner of that part
fn framed(picture: &Grid<f32>) -> (Grid<f32>, DVec2) {
    let Some((x0, y0, x1, y1)) = picture.map(|&v| v != 0.0).bounding_box() else {
        return (Grid::filled(1, 1, 0.0), DVec2::ZERO);
    };
    let (x0, y0) = (x0.saturating_sub(1), y0.saturating_sub(1));
    let (x1, y1) = (
        (x1 + 1).min(picture.width()),
        (y1 + 1).min(picture.height()),
    );
    let corner = DVec2::new(x0 as f64, y0 as f64);
    (picture.crop(x0, y0, x1 - x0, y1 - y0), corner)
}

/// One tape in one view; points of the reference pose move with the tissue below the tape
struct Sight<'a> {
    view: &'a SeenView<'a>,
    room_from_tape: DAffine3,
    tape_from_room: DAffine3,
}

impl Sight<'_> {
    /// Returns whether the avatar leaves a photo point uncovered
    fn expects_background(&self, point: DVec2) -> bool {
        // Beyond the picture, the values at its border are continued.
        bilinear(&self.view.expected, point - self.view.corner) < 0.5
    }

    fn camera_center(&self) -> DVec3 {
        self.tape_from_room
            .transform_point3(self.view.camera.center())
    }

    /// Returns the photo point of a point of the reference pose; `None` behind the camera
    fn project(&self, point: DVec3) -> Option<DVec2> {
        (self.depth(point) > 0.0).then(|| {
            let in_room = self.room_from_tape.transform_point3(point);
            self.view.camera.project(in_room)
        })
    }

    fn depth(&self, point: DVec3) -> f64 {
        let in_room = self.room_from_tape.transform_point3(point);
        self.view.camera.depth(in_room)
    }

    /// Returns the direction of the line of sight through a photo point
    fn ray(&self, point: DVec2) -> DVec3 {
        self.tape_from_room
            .transform_vector3(self.view.camera.ray(point))
    }

    /// Returns the direction that points to the right in the photo
    fn right(&self) -> DVec3 {
        self.tape_from_room.transform_vector3(DVec3::X)
    }
}

/// A line in the plane of a tape that the tape touches
#[derive(Debug, Clone, Copy)]
pub(super) struct SupportLine {
    /// Index of the view in which it was found
    pub(super) view: usize,
    /// Unit normal, outward
    normal: DVec2,
    /// Distance from the tape's expected center, in mm
    offset_mm: f64,
    /// Outward displacement of the line per mm that the silhouette is shifted to the right in the photo
    shift_rate: f64,
}

/// Outlines are searched up to this multiple of the avatar's extent
///
/// Bodies reach 1.6 times the avatar's; farther out lies another limb.
const MAX_EXTENT: f64 = 1.8;
/// Outlines are searched from this multiple of the avatar's extent on
const MIN_EXTENT: f64 = 0.5;
/// Outlines are searched at least this far inward and outward, in mm
///
/// Wrists are thinner than the position errors of forearms.
const MIN_REACH_MM: f64 = 30.0;

/// Free background that the avatar must show beyond an outline for it to count, in mm
///
/// With less, limbs that touch the trunk on larger bodies count as trunk; with more, thighs lose their inner sides.
const CLEARANCE_MM: f64 = 12.0;

/// Gradients of the distance map are computed over this distance to either side, in px
const GRADIENT_REACH_PX: f64 = 2.0;

/// Finds support lines of the tape in all views where its outline is free
pub(super) fn find_lines(tape: &Tape, views: &[SeenView]) -> Vec<SupportLine> {
    let mut lines = Vec::with_capacity(2 * views.len());
    for (index, view) in views.iter().enumerate() {
        let sight = view.sight(tape);
        for touch in touching_points(tape, &sight).into_iter().flatten() {
            lines.extend(find_line(tape, index, &sight, touch));
        }
    }
    lines
}

/// Finds the points where the two lines of sight in the plane graze the expected tape; `None` where the view looks
/// along its axis
fn touching_points(tape: &Tape, sight: &Sight) -> Option<[DVec2; 2]> {
    /// Nearer to the axis, the outline is that of a bent limb's end, not of its sides; in radii
    const MIN_DISTANCE_RADII: f64 = 3.0;
    let eye = tape.flatten(sight.camera_center() - tape.center());
    let radius = tape.hull().iter().map(|p| p.length()).fold(0.0, f64::max);
    if eye.length() < MIN_DISTANCE_RADII * radius {
        return None;
    }
    let angle = |p: &DVec2| (-eye).angle_to(*p - eye);
    let by_angle = |a: &&DVec2, b: &&DVec2| angle(a).total_cmp(&angle(b));
    let right = tape.hull().iter().min_by(by_angle)?;
    let left = tape.hull().iter().max_by(by_angle)?;
    Some([*right, *left])
}

fn find_line(tape: &Tape, index: usize, sight: &Sight, touch: DVec2) -> Option<SupportLine> {
    let inner = sight.project(tape.center())?;
    let outer = sight.project(tape.lift(touch))?;
    let outward = (outer - inner).try_normalize()?;
    let extent = outer.distance(inner);
    // The avatar must show background directly beyond the tape's edge.
    let camera = &sight.view.camera;
    let px_per_mm = camera.focal_px() / sight.depth(tape.center());
    const PROBES: u32 = 4;
    for probe in 1..=PROBES {
        let beyond = CLEARANCE_MM * f64::from(probe) / f64::from(PROBES);
        if !sight.expects_background(outer + outward * beyond * px_per_mm) {
            return None;
        }
    }
    let outline = &sight.view.outline;
    let at = |t: f64| {
        let p = inner + outward * t;
        outline.at(p.x, p.y)
    };
    let reach = MIN_REACH_MM * px_per_mm;
    let least = f64::min(MIN_EXTENT * extent, extent - reach);
    let most = f64::max(MAX_EXTENT * extent, extent + reach);
    let edge = inner + outward * nearest_edge(at, least, extent, most)?;
    let (width, height) = (camera.width_px as f64, camera.height_px as f64);
    let seen = edge.cmpgt(DVec2::splat(1.0)).all() && edge.x < width - 1.0 && edge.y < height - 1.0;
    if !seen {
        return None;
    }
    let slope = |step: DVec2| {
        let (after, before) = (edge + step, edge - step);
        outline.at(after.x, after.y) - outline.at(before.x, before.y)
    };
    let across = DVec2::new(
        slope(DVec2::X * GRADIENT_REACH_PX),
        slope(DVec2::Y * GRADIENT_REACH_PX),
    )
    .try_normalize()?;
    // An outline that runs along the search line is the end of a limb.
    if across.dot(outward) < 0.4 {
        return None;
    }
    let along = across.perp();
    let plane_normal = sight.ray(edge).cross(sight.ray(edge + along));
    let trace = tape.flatten(plane_normal);
    let steepness = trace.length();
    // Where the tangent plane is nearly parallel to the tape's, its trace is inexact everywhere.
    if steepness < 0.3 * plane_normal.length() {
        return None;
    }
    let offset_mm = plane_normal.dot(sight.camera_center() - tape.center()) / steepness;
    let sign = if trace.dot(touch) < 0.0 { -1.0 } else { 1.0 };
    Some(SupportLine {
        view: index,
        normal: trace * (sign / steepness),
        offset_mm: sign * offset_mm,
        shift_rate: sign * plane_normal.dot(sight.right()) / steepness,
    })
}

/// Returns the distance from the center at which the silhouette ends, nearest to the expected one; `None` if outside
/// the range
fn nearest_edge(
    signed_distance: impl Fn(f64) -> f64,
    least: f64,
    expected: f64,
    most: f64,
) -> Option<f64> {
    /// Step of the search, in px: thinner gaps do not count as background
    const STEP_PX: f64 = 0.5;
    let inside = |t: f64| signed_distance(t) < 0.0;
    let (mut inner, mut outer) = if inside(expected) {
        let mut t = expected;
        while inside(t + STEP_PX) {
            t += STEP_PX;
            if t > most {
                return None;
            }
        }
        (t, t + STEP_PX)
    } else {
        let mut t = expected;
        while !inside(t - STEP_PX) {
            t -= STEP_PX;
            if t < least {
                return None;
            }
        }
        (t - STEP_PX, t)
    };
    const HALVINGS: usize = 12;
    for _ in 0..HALVINGS {
        let middle = (inner + outer) / 2.0;
        if inside(middle) {
            inner = middle;
        } else {
            outer = middle;
        }
    }
    Some((inner + outer) / 2.0)
}

/// A tape's length estimated from support lines
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FittedGirth {
    /// Length of the tape, in mm
    pub(super) girth_mm: f64,
    /// Standard deviation, in mm, from the scatter of the lines and the priors
    pub(super) sd_mm: f64,
    /// Number of lines consistent with the tape
    pub(super) line_count: usize,
    /// Number of views that these lines come from
    pub(super) view_count: usize,
    /// Center of the tape in its plane relative to the expected one, in mm
    pub(super) shift: DVec2,
}

/// Standard deviation of a support line from an outline, in mm: about half a pixel
const LINE_SIGMA_MM: f64 = 1.2;

/// Standard deviation of the sideways shift of a silhouette against the others, in mm
///
/// Remains of sway after normalization. A shift moves the two outlines of a view in opposite directions and does not
/// change the girth; with a larger value, tapes with one outline per view lose their center.
const SHIFT_SIGMA_MM: f64 = 12.0;

/// Prior of the difference from the scaled avatar, per harmonic, as a share of the radius
///
/// The first moves the center, the second makes the tape more or less flat, the third pear-shaped, the fourth boxy.
const HARMONIC_SIGMAS: [f64; 4] = [0.4, 0.10, 0.03, 0.015];

/// Lower bound of the prior of the center, in mm: thin limbs are misplaced by more than their radius
const CENTER_SIGMA_MM: f64 = 25.0;

/// Prior of the girth itself, as a share of the avatar's: nearly free
const SIZE_SIGMA: f64 = 0.5;

/// Fits the avatar's tape, scaled and bent by four harmonics, to support lines; the girth follows from Cauchy's formula
///
/// Lines of limbs that hide the outline are outliers and lose their weight. `None` without lines.
pub(super) fn fit_girth(
    tape: &Tape,
    lines: &[SupportLine],
    view_count: usize,
) -> Option<FittedGirth> {
    /// Rounds: each updates the scale of the avatar's shape and the weights
    const ROUNDS: usize = 10;
    if lines.is_empty() {
        return None;
    }
    let expected_mean = tape.girth() / TAU;
    let mut scale = 1.0;
    let mut weights = vec![1.0; lines.len()];
    let mut solution = None;
    for round in 0..ROUNDS {
        let radius = scale * expected_mean;
        let problem = Problem::new(tape, lines, &weights, view_count, scale, radius);
        let solved = problem.solve()?;
        let mean = radius + solved.unknowns[0];
        if mean.is_nan() || mean <= 0.0 {
            return None;
        }
        // Wide at first, so that a bad start does not reject correct lines; never below the usual value
        let wide = 0.15 * mean / (1 << round.min(4)) as f64;
        let tolerance = wide.max(3.0 * LINE_SIGMA_MM);
        for (weight, residual) in weights.iter_mut().zip(&solved.residuals) {
            *weight = 1.0 / (1.0 + (residual / tolerance).powi(2)).powi(2);
        }
        scale = mean / expected_mean;
        solution = Some((solved, mean));
    }
    let (solved, mean) = solution?;
    let kept = || lines.iter().zip(&weights).filter(|&(_, &w)| w > 0.25);
    let mut seen = vec![false; view_count];
    for (line, _) in kept() {
        seen[line.view] = true;
    }
    Some(FittedGirth {
        girth_mm: TAU * mean,
        sd_mm: TAU * solved.mean_sigma,
        line_count: kept().count(),
        view_count: seen.into_iter().filter(|&s| s).count(),
        shift: DVec2::new(solved.unknowns[1], solved.unknowns[2]),
    })
}

/// Linear least squares for one round: mean radius, four harmonics, one shift per view
struct Problem {
    /// One row per line: derivatives with respect to the unknowns
    rows: Vec<Vec<f64>>,
    /// Per line: measured minus expected offset
    targets: Vec<f64>,
    weights: Vec<f64>,
    /// Prior standard deviation of each unknown, around zero
    priors: Vec<f64>,
}

struct Solved {
    unknowns: Vec<f64>,
    /// Standard deviation of the mean radius
    mean_sigma: f64,
    /// Per line
    residuals: Vec<f64>,
}

impl Problem {
    fn new(
        tape: &Tape,
        lines: &[SupportLine],
        weights: &[f64],
        view_count: usize,
        scale: f64,
        radius: f64,
    ) -> Self {
        let mut priors = vec![SIZE_SIGMA * radius];
        for sigma in HARMONIC_SIGMAS {
            priors.extend([sigma * radius; 2]);
        }
        for sigma in &mut priors[1..3] {
            *sigma = sigma.max(CENTER_SIGMA_MM);
        }
        let shifts = priors.len();
        priors.extend(vec![SHIFT_SIGMA_MM; view_count]);
        let row = |line: &SupportLine| {
            let mut row = vec![0.0; priors.len()];
            row[0] = 1.0;
            let angle = line.normal.to_angle();
            for k in 0..HARMONIC_SIGMAS.len() {
                let (sin, cos) = ((k + 1) as f64 * angle).sin_cos();
                (row[1 + 2 * k], row[2 + 2 * k]) = (cos, sin);
            }
            row[shifts + line.view] = line.shift_rate;
            row
        };
        Self {
            rows: lines.iter().map(row).collect(),
            targets: lines
                .iter()
                .map(|line| line.offset_mm - scale * tape.support(line.normal))
                .collect(),
            weights: weights.to_vec(),
            priors,
        }
    }

    fn solve(&self) -> Option<Solved> {
        let n = self.priors.len();
        let information = 1.0 / LINE_SIGMA_MM.powi(2);
        let mut normal = faer::Mat::<f64>::zeros(n, n);
        // The second column yields the variance of the first unknown.
        let mut right = faer::Mat::<f64>::zeros(n, 2);
        right[(0, 1)] = 1.0;
        for (k, prior) in self.priors.iter().enumerate() {
            normal[(k, k)] = prior.powi(-2);
        }
        for ((row, target), weight) in self.rows.iter().zip(&self.targets).zip(&self.weights) {
            for i in 0..n {
                for j in 0..n {
                    normal[(i, j)] += weight * information * row[i] * row[j];
                }
                right[(i, 0)] += weight * information * row[i] * target;
            }
        }
        let solved = normal.llt(faer::Side::Lower).ok()?.solve(&right);
        let unknowns: Vec<f64> = (0..n).map(|i| solved[(i, 0)]).collect();
        let predicted = |row: &Vec<f64>| row.iter().zip(&unknowns).map(|(a, b)| a * b).sum::<f64>();
        let residuals = self.rows.iter().zip(&self.targets);
        let residuals: Vec<f64> = residuals
            .map(|(row, target)| target - predicted(row))
            .collect();
        let finite = unknowns.iter().chain(&residuals).all(|v| v.is_finite());
        finite.then(|| Solved {
            mean_sigma: solved[(0, 1)].max(0.0).sqrt(),
            unknowns,
            residuals,
        })
    }
}

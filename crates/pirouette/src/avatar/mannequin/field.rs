//! The body as a smooth implicit surface: tubes, ellipsoids and cones, blended where they meet.
//!
//! The field is negative inside and about the distance to the surface in mm near it; far away it only has the right
//! sign. The body is symmetric: fields are asked on the person's left side (x >= 0) only, and parts of the
//! left side know their mirror images.

use glam::{DMat3, DVec2, DVec3};

/// What the field answers far from every part, in mm
pub(super) const FAR: f64 = 1e3;

/// Points farther than this outside a part's box do not ask it, in mm (on top of its blend radius)
const BOX_MARGIN: f64 = 12.0;

/// A cross-section of a tube: an egg of two half-ellipses in each direction, squared off or not
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Section {
    /// Shift of the section's center off the tube's axis, to the side and to the front
    pub center: DVec2,
    /// Radius to the side, away from the body's middle
    pub outer: f64,
    /// Radius to the other side
    pub inner: f64,
    /// Radius to the front
    pub front: f64,
    /// Radius to the back
    pub back: f64,
    /// Squareness of the front half: 0 elliptic, 1 a superellipse of exponent 4
    pub square_front: f64,
    /// Squareness of the back half
    pub square_back: f64,
}

impl Section {
    fn channels(&self) -> [f64; 8] {
        [
            self.center.x,
            self.center.y,
            self.outer,
            self.inner,
            self.front,
            self.back,
            self.square_front,
            self.square_back,
        ]
    }

    fn from_channels(c: [f64; 8]) -> Self {
        Self {
            center: DVec2::new(c[0], c[1]),
            outer: c[2],
            inner: c[3],
            front: c[4],
            back: c[5],
            square_front: c[6],
            square_back: c[7],
        }
    }

    fn lerp(&self, other: &Self, t: f64) -> Self {
        let (a, b) = (self.channels(), other.channels());
        Self::from_channels(std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t))
    }

    /// Distance of a point of the section's plane from the section's center, and that as a multiple of the radius there
    fn polar(&self, p: DVec2) -> (f64, f64) {
        let q = p - self.center;
        let u = q.x / if q.x >= 0.0 { self.outer } else { self.inner };
        let (depth, square) = if q.y >= 0.0 {
            (self.front, self.square_front)
        } else {
            (self.back, self.square_back)
        };
        let w = q.y / depth;
        let (u2, w2) = (u * u, w * w);
        let round = (u2 + w2).sqrt();
        let ratio = if square.abs() < 1e-6 {
            round
        } else {
            let squared = (u2 * u2 + w2 * w2).sqrt().sqrt();
            round + (squared - round) * square
        };
        (q.length(), ratio)
    }

    fn smallest_radius(&self) -> f64 {
        self.outer.min(self.inner).min(self.front).min(self.back)
    }

    fn reach(&self) -> f64 {
        self.center.length() + self.outer.max(self.inner).max(self.front).max(self.back)
    }
}

/// A tube of varying sections along a straight axis, closed by half-ellipsoids
#[derive(Debug, Clone)]
pub(super) struct Tube {
    origin: DVec3,
    /// Columns: to the side, along, to the front
    axes: DMat3,
    start: f64,
    end: f64,
    step: f64,
    sections: Vec<Section>,
    /// Length of the half-ellipsoids beyond start and end
    caps: [f64; 2],
}

/// Spacing of the tabulated sections of a tube, in mm
///
/// Linear interpolation over it stays within 0.1 mm of the curves.
const SECTION_STEP: f64 = 4.0;

impl Tube {
    /// Runs a smooth curve through sections given at increasing stations along the axis
    ///
    /// # Panics
    /// With less than two keys.
    pub(super) fn new(origin: DVec3, axes: DMat3, keys: &[(f64, Section)], caps: [f64; 2]) -> Self {
        let stations: Vec<f64> = keys.iter().map(|(t, _)| *t).collect();
        let channels: Vec<[f64; 8]> = keys.iter().map(|(_, s)| s.channels()).collect();
        let curves: [Curve; 8] = std::array::from_fn(|c| {
            Curve::new(
                stations
                    .iter()
                    .zip(&channels)
                    .map(|(&t, values)| (t, values[c]))
                    .collect(),
            )
        });
        let (start, end) = (stations[0], stations[stations.len() - 1]);
        let count = ((end - start) / SECTION_STEP).ceil().max(1.0);
        let step = (end - start) / count;
        let sections: Vec<Section> = (0..=count as usize)
            .map(|i| {
                let t = start + step * i as f64;
                Section::from_channels(std::array::from_fn(|c| curves[c].at(t)))
            })
            .collect();
        Self {
            origin,
            axes,
            start,
            end,
            step,
            sections,
            caps,
        }
    }

    /// Rounds off what the curves bend too suddenly, over about `width` mm along the axis; the end sections stay
    pub(super) fn smoothed(mut self, width: f64) -> Self {
        // Each pass of weights 1/4, 1/2, 1/4 adds half a step squared to the variance.
        let passes = (2.0 * (width / self.step).powi(2)).ceil() as usize;
        let mut values: Vec<[f64; 8]> = self.sections.iter().map(Section::channels).collect();
        for _ in 0..passes {
            let mut before = values[0];
            for i in 1..values.len().saturating_sub(1) {
                let own = values[i];
                let after = values[i + 1];
                values[i] =
                    std::array::from_fn(|c| 0.25 * before[c] + 0.5 * own[c] + 0.25 * after[c]);
                before = own;
            }
        }
        self.sections = values.into_iter().map(Section::from_channels).collect();
        self
    }

    /// The section at a station along the axis
    pub(super) fn section(&self, station: f64) -> Section {
        let x = ((station.clamp(self.start, self.end) - self.start) / self.step).max(0.0);
        let last = self.sections.len() - 1;
        let i = (x as usize).min(last.saturating_sub(1));
        self.sections[i].lerp(&self.sections[(i + 1).min(last)], x - i as f64)
    }

    /// Coordinates of a point along side, axis and front
    pub(super) fn local(&self, p: DVec3) -> DVec3 {
        self.axes.transpose() * (p - self.origin)
    }

    /// The point at these coordinates along side, axis and front
    pub(super) fn world(&self, local: DVec3) -> DVec3 {
        self.origin + self.axes * local
    }

    fn distance(&self, p: DVec3) -> f64 {
        let q = self.local(p);
        let section = self.section(q.y);
        let (radial, ratio) = section.polar(DVec2::new(q.x, q.z));
        let (beyond, cap) = if q.y > self.end {
            (q.y - self.end, self.caps[1])
        } else if q.y < self.start {
            (self.start - q.y, self.caps[0])
        } else {
            (0.0, 1.0)
        };
        let (length, ratio) = if beyond > 0.0 {
            (radial.hypot(beyond), ratio.hypot(beyond / cap.max(1e-3)))
        } else {
            (radial, ratio)
        };
        if ratio < 1e-3 {
            return -section.smallest_radius();
        }
        length - length / ratio
    }

    fn bounds(&self) -> (DVec3, DVec3) {
        let reach = self.sections.iter().map(Section::reach).fold(0.0, f64::max);
        let ends = [self.start - self.caps[0], self.end + self.caps[1]]
            .map(|t| self.world(DVec3::new(0.0, t, 0.0)));
        // A disk across a unit axis reaches sqrt(1 - axis^2) of its radius along each coordinate.
        let axis = self.axes.y_axis;
        let disk = (DVec3::ONE - axis * axis).max(DVec3::ZERO).map(f64::sqrt) * reach;
        (ends[0].min(ends[1]) - disk, ends[0].max(ends[1]) + disk)
    }
}

/// A smooth curve through given points that does not overshoot them
///
/// # Source
/// Fritsch and Butland 1984, "A method for constructing local monotone piecewise cubic interpolants".
#[derive(Debug, Clone)]
pub(super) struct Curve {
    points: Vec<(f64, f64)>,
    slopes: Vec<f64>,
}

impl Curve {
    /// Through points of increasing abscissa
    pub(super) fn new(points: Vec<(f64, f64)>) -> Self {
        let n = points.len();
        let rise = |i: usize| -> f64 {
            (points[i + 1].1 - points[i].1) / (points[i + 1].0 - points[i].0).max(1e-9)
        };
        let slopes = (0..n)
            .map(|i| {
                if n < 2 || i == 0 || i == n - 1 {
                    return if n < 2 { 0.0 } else { rise(i.min(n - 2)) * 0.8 };
                }
                let (a, b) = (rise(i - 1), rise(i));
                if a * b <= 0.0 {
                    return 0.0;
                }
                let (h0, h1) = (points[i].0 - points[i - 1].0, points[i + 1].0 - points[i].0);
                let alpha = (h0 + 2.0 * h1) / (3.0 * (h0 + h1));
                a * b / (alpha * b + (1.0 - alpha) * a)
            })
            .collect();
        Self { points, slopes }
    }

    /// Value at an abscissa; constant beyond the ends
    pub(super) fn at(&self, x: f64) -> f64 {
        let after = self.points.partition_point(|(px, _)| *px <= x);
        if after == 0 {
            return self.points[0].1;
        }
        if after == self.points.len() {
            return self.points[after - 1].1;
        }
        let ((x0, y0), (x1, y1)) = (self.points[after - 1], self.points[after]);
        let h = x1 - x0;
        let t = (x - x0) / h;
        let (m0, m1) = (self.slopes[after - 1] * h, self.slopes[after] * h);
        let (t2, t3) = (t * t, t * t * t);
        y0 * (2.0 * t3 - 3.0 * t2 + 1.0)
            + m0 * (t3 - 2.0 * t2 + t)
            + y1 * (3.0 * t2 - 2.0 * t3)
            + m1 * (t3 - t2)
    }
}

/// One building block of the body
#[derive(Debug, Clone)]
pub(super) enum Shape {
    /// A tube of varying sections
    Tube(Tube),
    /// An ellipsoid with radii along the columns of `axes`
    Ellipsoid {
        center: DVec3,
        axes: DMat3,
        radii: DVec3,
    },
    /// The hull of two balls
    Cone {
        from: DVec3,
        to: DVec3,
        radii: [f64; 2],
    },
}

impl Shape {
    /// An ellipsoid along the axes of the world
    pub(super) fn ellipsoid(center: DVec3, radii: DVec3) -> Self {
        Shape::Ellipsoid {
            center,
            axes: DMat3::IDENTITY,
            radii,
        }
    }

    fn distance(&self, p: DVec3) -> f64 {
        match self {
            Shape::Tube(tube) => tube.distance(p),
            Shape::Ellipsoid {
                center,
                axes,
                radii,
            } => {
                let q = axes.transpose() * (p - *center) / *radii;
                let ratio = q.length();
                let gradient = (q / *radii).length();
                if gradient < 1e-9 {
                    return -radii.min_element();
                }
                ratio * (ratio - 1.0) / gradient
            }
            Shape::Cone { from, to, radii } => {
                let axis = *to - *from;
                let t = ((p - *from).dot(axis) / axis.length_squared().max(1e-12)).clamp(0.0, 1.0);
                (p - (*from + axis * t)).length() - (radii[0] + (radii[1] - radii[0]) * t)
            }
        }
    }

    fn bounds(&self) -> (DVec3, DVec3) {
        match self {
            Shape::Tube(tube) => tube.bounds(),
            Shape::Ellipsoid {
                center,
                axes,
                radii,
            } => {
                let scaled = DMat3::from_cols(
                    axes.x_axis * radii.x,
                    axes.y_axis * radii.y,
                    axes.z_axis * radii.z,
                )
                .transpose();
                let reach = DVec3::new(
                    scaled.x_axis.length(),
                    scaled.y_axis.length(),
                    scaled.z_axis.length(),
                );
                (*center - reach, *center + reach)
            }
            Shape::Cone { from, to, radii } => {
                let r = DVec3::splat(radii[0].max(radii[1]));
                (from.min(*to) - r, from.max(*to) + r)
            }
        }
    }
}

/// To which region of the body a part belongs; tapes and skinning weights ask by region
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Region {
    Trunk,
    Neck,
    Head,
    Arm,
    Hand,
    Leg,
    Foot,
}

/// Whether the mirror images of the left side's parts count
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sides {
    Both,
    Left,
}

/// A shape and how it joins what came before it
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub region: Region,
    pub shape: Shape,
    /// Width of the fillet with the parts before it, in mm
    pub blend: f64,
    /// Width of the fillet with its own mirror image; `None` for parts of the middle
    pub mirror_blend: Option<f64>,
    bounds: (DVec3, DVec3),
}

/// A smooth swelling or hollow of the surface: muscles, furrows and folds too shallow to be parts of their own
#[derive(Debug, Clone)]
pub(super) struct Relief {
    pub region: Region,
    /// The point of the left side or the middle where it is strongest; its mirror image has the same
    pub center: DVec3,
    /// Columns: the directions of `radii`
    pub axes: DMat3,
    /// Where it has faded out
    pub radii: DVec3,
    /// How far the surface moves outward at the center, in mm; inward when negative
    pub height: f64,
}

impl Relief {
    fn at(&self, p: DVec3) -> f64 {
        let from = p - self.center;
        if from.abs().max_element() > self.radii.max_element() {
            return 0.0;
        }
        let q = self.axes.transpose() * from / self.radii;
        let rest = 1.0 - q.length_squared();
        if rest > 0.0 {
            self.height * rest * rest
        } else {
            0.0
        }
    }
}

/// The whole body
#[derive(Debug, Clone, Default)]
pub(super) struct Field {
    parts: Vec<Part>,
    reliefs: Vec<Relief>,
}

/// Width of the rounding where the soles meet the floor, in mm
const SOLE_ROUNDING: f64 = 5.0;

impl Field {
    /// Adds a part of the middle
    pub(super) fn add(&mut self, region: Region, shape: Shape, blend: f64) {
        self.push(region, shape, blend, None);
    }

    /// Adds a part of the left side and its mirror image
    pub(super) fn add_pair(&mut self, region: Region, shape: Shape, blend: f64, mirror_blend: f64) {
        self.push(region, shape, blend, Some(mirror_blend));
    }

    /// Adds a swelling or hollow; one off the middle comes with its mirror image
    pub(super) fn add_relief(&mut self, relief: Relief) {
        self.reliefs.push(relief);
    }

    fn push(&mut self, region: Region, shape: Shape, blend: f64, mirror_blend: Option<f64>) {
        let margin = DVec3::splat(blend.max(mirror_blend.unwrap_or(0.0)) + BOX_MARGIN);
        let (lo, hi) = shape.bounds();
        self.parts.push(Part {
            region,
            shape,
            blend,
            mirror_blend,
            bounds: (lo - margin, hi + margin),
        });
    }

    /// Signed value at a point of the left side (x >= 0), cut flat at the floor
    pub(super) fn value(&self, p: DVec3) -> f64 {
        cut_at_floor(self.value_of(p, |_| true, Sides::Both), p.y)
    }

    /// Signed value of some regions, not cut at the floor
    pub(super) fn value_of(
        &self,
        p: DVec3,
        included: impl Fn(Region) -> bool,
        sides: Sides,
    ) -> f64 {
        let parts = self.parts.iter().filter(|part| included(part.region));
        let reliefs = self.reliefs.iter().filter(|r| included(r.region));
        value_over(parts, reliefs, p, sides)
    }

    /// What shapes the surface within `reach` mm of a point of the left side
    pub(super) fn around(&self, p: DVec3, reach: f64) -> Neighborhood<'_> {
        let mirrored = DVec3::new(-p.x, p.y, p.z);
        let touches = |(lo, hi): (DVec3, DVec3), pair: bool| {
            let near = |q: DVec3| (q + reach).cmpge(lo).all() && (q - reach).cmple(hi).all();
            near(p) || pair && near(mirrored)
        };
        let parts = self.parts.iter();
        let reliefs = self.reliefs.iter();
        Neighborhood {
            parts: parts
                .filter(|part| touches(part.bounds, part.mirror_blend.is_some()))
                .collect(),
            reliefs: reliefs
                .filter(|r| {
                    let radius = DVec3::splat(r.radii.max_element());
                    touches((r.center - radius, r.center + radius), r.center.x > 0.0)
                })
                .collect(),
        }
    }

    /// Where a ray leaves the body; `from` lies inside, on the left side or the mirror plane
    pub(super) fn exit(&self, from: DVec3, direction: DVec3) -> DVec3 {
        let mut p = from;
        for _ in 0..200 {
            let value = self.value(DVec3::new(p.x.abs(), p.y, p.z));
            if value > -0.01 {
                break;
            }
            p += direction * (-0.8 * value);
        }
        p
    }

    /// Smallest and largest coordinates that the left side's parts may reach
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let none = (DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY));
        self.parts.iter().fold(none, |(lo, hi), part| {
            (lo.min(part.bounds.0), hi.max(part.bounds.1))
        })
    }
}

/// The field near one place, faster to ask
#[derive(Debug)]
pub(super) struct Neighborhood<'a> {
    parts: Vec<&'a Part>,
    reliefs: Vec<&'a Relief>,
}

impl Neighborhood<'_> {
    /// Signed value at a point of either side, cut flat at the floor
    pub(super) fn value(&self, p: DVec3) -> f64 {
        let left = DVec3::new(p.x.abs(), p.y, p.z);
        let (parts, reliefs) = (self.parts.iter().copied(), self.reliefs.iter().copied());
        cut_at_floor(value_over(parts, reliefs, left, Sides::Both), p.y)
    }

    /// Gradient by differences over `step` mm; at the mirror plane it lies in the plane
    pub(super) fn gradient(&self, p: DVec3, step: f64) -> DVec3 {
        // Four samples at the corners of a tetrahedron.
        let corners = [
            DVec3::new(1.0, -1.0, -1.0),
            DVec3::new(-1.0, -1.0, 1.0),
            DVec3::new(-1.0, 1.0, -1.0),
            DVec3::new(1.0, 1.0, 1.0),
        ];
        let slopes = corners.iter().map(|&c| c * self.value(p + c * step));
        slopes.sum::<DVec3>() / (4.0 * step)
    }
}

fn cut_at_floor(body: f64, height: f64) -> f64 {
    -smooth_min(-body, height, SOLE_ROUNDING)
}

/// The blend of parts in their order, with the reliefs on it
fn value_over<'a>(
    parts: impl Iterator<Item = &'a Part>,
    reliefs: impl Iterator<Item = &'a Relief>,
    p: DVec3,
    sides: Sides,
) -> f64 {
    let mut value = FAR;
    let mirrored = DVec3::new(-p.x, p.y, p.z);
    for part in parts {
        let (lo, hi) = part.bounds;
        let near = |q: DVec3| q.cmpge(lo).all() && q.cmple(hi).all();
        let own = near(p).then(|| part.shape.distance(p));
        let other = match part.mirror_blend {
            Some(blend) if sides == Sides::Both && near(mirrored) => {
                Some((part.shape.distance(mirrored), blend))
            }
            _ => None,
        };
        let distance = match (own, other) {
            (Some(a), Some((b, blend))) => smooth_min(a, b, blend),
            (Some(a), None) => a,
            (None, Some((b, _))) => b,
            (None, None) => continue,
        };
        value = smooth_min(value, distance, part.blend);
    }
    if value >= FAR {
        return value;
    }
    for relief in reliefs {
        value -= relief.at(p);
        if sides == Sides::Both && relief.center.x > 0.0 {
            value -= relief.at(mirrored);
        }
    }
    value
}

/// The smaller of two distances, with a fillet of width `blend` where they are about equal
pub(super) fn smooth_min(a: f64, b: f64, blend: f64) -> f64 {
    let h = blend - (a - b).abs();
    if h <= 0.0 {
        return a.min(b);
    }
    a.min(b) - h * h / (4.0 * blend)
}

/// Smooth step from 0 at `from` to 1 at `to`
pub(super) fn ramp(x: f64, from: f64, to: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

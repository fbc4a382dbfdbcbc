//! The body as a smooth implicit surface: tubes, ellipsoids and cones, blended where they meet.
//!
//! The field is negative inside and approximates the distance to the surface in mm near it; far away only its sign is
//! valid. The body is symmetric: fields are evaluated on the person's left side (x >= 0) only, and parts of the left
//! side include their mirror images.

use glam::{DMat3, DVec3};

use super::primitives::Shape;

/// Value of the field far from every part, in mm
pub(super) const FAR: f64 = 1e3;

/// Parts whose box is farther away than this from a point, in mm (in addition to the blend radius), are not evaluated
const BOX_MARGIN: f64 = 12.0;

/// Region of the body to which a part belongs; tapes and skinning weights select parts by region
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

/// Whether the mirror images of the left side's parts are included
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sides {
    Both,
    Left,
}

/// A shape and its blend with the preceding parts
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub region: Region,
    pub shape: Shape,
    /// Width of the fillet with the preceding parts, in mm
    pub blend: f64,
    /// Width of the fillet with its own mirror image; `None` for parts of the middle
    pub mirror_blend: Option<f64>,
    bounds: (DVec3, DVec3),
}

/// A smooth bulge or hollow of the surface: muscles, furrows and folds too shallow to be separate parts
#[derive(Debug, Clone)]
pub(super) struct Relief {
    pub region: Region,
    /// Point of the left side or the middle where it is strongest; its mirror image has the same height
    pub center: DVec3,
    /// Columns: the directions of `radii`
    pub axes: DMat3,
    /// Distances at which it has faded out
    pub radii: DVec3,
    /// Outward displacement of the surface at the center, in mm; inward when negative
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

/// The complete body
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

    /// Adds a bulge or hollow; one off the middle is mirrored
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

    /// Returns the signed value at a point of the left side (x >= 0), cut flat at the floor
    pub(super) fn value(&self, p: DVec3) -> f64 {
        cut_at_floor(self.value_of(p, |_| true, Sides::Both), p.y)
    }

    /// Returns the signed value of some regions, not cut at the floor
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

    /// Collects the parts that shape the surface within `reach` mm of a point of the left side
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

    /// Finds the point where a ray leaves the body; `from` lies inside, on the left side or the mirror plane
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

    /// Returns the smallest and largest coordinates that the left side's parts can reach
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let none = (DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY));
        self.parts.iter().fold(none, |(lo, hi), part| {
            (lo.min(part.bounds.0), hi.max(part.bounds.1))
        })
    }
}

/// The field near one point, faster to evaluate
#[derive(Debug)]
pub(super) struct Neighborhood<'a> {
    parts: Vec<&'a Part>,
    reliefs: Vec<&'a Relief>,
}

impl Neighborhood<'_> {
    /// Returns the signed value at a point of either side, cut flat at the floor
    pub(super) fn value(&self, p: DVec3) -> f64 {
        let left = DVec3::new(p.x.abs(), p.y, p.z);
        let (parts, reliefs) = (self.parts.iter().copied(), self.reliefs.iter().copied());
        cut_at_floor(value_over(parts, reliefs, left, Sides::Both), p.y)
    }

    /// Computes the gradient by differences over `step` mm; at the mirror plane it lies in the plane
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

/// Blends parts in their order and adds the reliefs
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

/// Returns the smaller of two distances, with a fillet of width `blend` where they are about equal
pub(super) fn smooth_min(a: f64, b: f64, blend: f64) -> f64 {
    let h = blend - (a - b).abs();
    if h <= 0.0 {
        return a.min(b);
    }
    a.min(b) - h * h / (4.0 * blend)
}

/// Returns a smooth step from 0 at `from` to 1 at `to`
pub(super) fn ramp(x: f64, from: f64, to: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

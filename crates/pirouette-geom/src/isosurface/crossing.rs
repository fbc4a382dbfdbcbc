//! Crossings of the surface with edges of the grid.

use glam::DVec3;

use super::field::Field;

/// Minimum distance of vertices from the ends of an edge, as a fraction of it, so that no triangle degenerates
pub(super) const MIN_EDGE_PART: f64 = 1e-3;

/// A grid edge along which the field changes its sign, and the bracket of the crossing
#[derive(Debug, Clone)]
pub(super) struct Crossing {
    start: DVec3,
    along: DVec3,
    /// Positions between which the field changes its sign, as fractions of the edge, and the values there
    bracket: [(f64, f64); 2],
    /// Position of the crossing, as a fraction of the edge
    t: f64,
    /// Which end of the bracket was moved last
    moved: Option<usize>,
    /// Whether further evaluations cannot improve the crossing
    done: bool,
}

impl Crossing {
    /// Creates an edge from `start` to `start + along` with the values of the field at its ends
    pub(super) fn new(start: DVec3, along: DVec3, [a, b]: [f64; 2]) -> Self {
        Self {
            start,
            along,
            bracket: [(0.0, a), (1.0, b)],
            t: a / (a - b),
            moved: None,
            done: false,
        }
    }

    pub(super) fn position(&self) -> DVec3 {
        self.start + self.along * self.t.clamp(MIN_EDGE_PART, 1.0 - MIN_EDGE_PART)
    }

    /// Narrows the bracket by the value at `t`; `last` when no evaluation follows
    fn narrow(&mut self, value: f64, last: bool) {
        self.done |= value.is_nan();
        if self.done {
            return;
        }
        let end = usize::from((value < 0.0) != (self.bracket[0].1 < 0.0));
        self.bracket[end] = (self.t, value);
        // Illinois rule: an end kept twice counts half, or a curved field would never move it. The point computed this
        // way is only one to evaluate, not a result.
        if self.moved == Some(end) && !last {
            self.bracket[1 - end].1 /= 2.0;
        }
        self.moved = Some(end);
        let [(ta, a), (tb, b)] = self.bracket;
        let refined = ta + (tb - ta) * a / (a - b);
        self.done = !refined.is_finite();
        if !self.done {
            self.t = refined;
        }
    }
}

/// Refines neighboring crossings beyond linear interpolation, with `steps` evaluations of the field each
pub(super) fn refine<F: Field>(field: &F, part: F::Part, steps: usize, crossings: &mut [Crossing]) {
    /// Maximum number of crossings evaluated together
    const RUN: usize = 32;
    for crossings in crossings.chunks_mut(RUN) {
        let mut points = [DVec3::ZERO; RUN];
        let mut values = [0.0; RUN];
        let count = crossings.len();
        for step in 1..=steps {
            for (point, crossing) in points.iter_mut().zip(&*crossings) {
                *point = crossing.start + crossing.along * crossing.t;
            }
            field.values(&points[..count], part, &mut values[..count]);
            for (crossing, &value) in crossings.iter_mut().zip(&values) {
                crossing.narrow(value, step == steps);
            }
        }
    }
}

//! Where the surface crosses an edge of the grid.

use glam::DVec3;

use super::field::Field;

/// Vertices keep this part of an edge from its ends, so that no triangle shrinks to a point
pub(super) const MIN_EDGE_PART: f64 = 1e-3;

/// A grid edge along which the field changes its sign, and what is known of the place
#[derive(Debug, Clone)]
pub(super) struct Crossing {
    start: DVec3,
    along: DVec3,
    /// Parts of the edge between which the field changes its sign, and its values there
    bracket: [(f64, f64); 2],
    /// The place, as part of the edge
    t: f64,
    /// Which end of the bracket was moved last
    moved: Option<usize>,
    /// Whether the field tells no more
    done: bool,
}

impl Crossing {
    /// An edge from `start` to `start + along` with the values of the field at its ends
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

    /// Narrows the bracket by the value at `t`; `last` when no other follows
    fn narrow(&mut self, value: f64, last: bool) {
        self.done |= value.is_nan();
        if self.done {
            return;
        }
        let end = usize::from((value < 0.0) != (self.bracket[0].1 < 0.0));
        self.bracket[end] = (self.t, value);
        // Illinois rule: an end that stays twice counts half, or a bent field would hold it for ever. The
        // point found so is one to evaluate, not a result.
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

/// Refines crossings that lie close together beyond linear interpolation, by as many evaluations of the field for each
pub(super) fn refine<F: Field>(field: &F, part: F::Part, steps: usize, crossings: &mut [Crossing]) {
    /// Crossings that are evaluated together
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

//! Scalar fields for surface extraction.

use glam::DVec3;

/// A scalar field that may have a simpler representation in a part of space
pub trait Field: Sync {
    /// Representation of the field in a part of space
    type Part: Copy + Send + Sync;

    /// Returns the representation that holds everywhere
    fn whole(&self) -> Self::Part;

    /// Returns the value at a point where `part` holds
    fn value(&self, point: DVec3, part: Self::Part) -> f64;

    /// Whether the value at a point is negative
    fn is_inside(&self, point: DVec3, part: Self::Part) -> bool {
        self.value(point, part) < 0.0
    }

    /// Computes the values at points that lie close together
    ///
    /// # Panics
    /// When the numbers of values and points differ.
    fn values(&self, points: &[DVec3], part: Self::Part, values: &mut [f64]) {
        assert_eq!(points.len(), values.len(), "one value per point");
        for (value, &point) in values.iter_mut().zip(points) {
            *value = self.value(point, part);
        }
    }

    /// Returns the value at the center of a ball in which `of` holds, and a part that holds in the ball
    ///
    /// The part has the same values as the full field.
    fn near(&self, center: DVec3, radius: f64, of: Self::Part) -> (f64, Self::Part);
}

impl<F: Fn(DVec3) -> f64 + Sync> Field for F {
    type Part = ();

    fn whole(&self) {}

    fn value(&self, point: DVec3, _part: ()) -> f64 {
        self(point)
    }

    fn near(&self, center: DVec3, _radius: f64, _of: ()) -> (f64, ()) {
        (self(center), ())
    }
}

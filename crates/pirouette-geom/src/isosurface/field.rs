//! What a surface is extracted from.

use glam::DVec3;

/// A scalar field that may be simpler near a place than as a whole
pub trait Field: Sync {
    /// What is left of the field near a place
    type Part: Copy + Send + Sync;

    /// The field everywhere
    fn whole(&self) -> Self::Part;

    /// The value at a point where the part holds
    fn value(&self, point: DVec3, part: Self::Part) -> f64;

    /// Whether the value at a point is negative
    fn is_inside(&self, point: DVec3, part: Self::Part) -> bool {
        self.value(point, part) < 0.0
    }

    /// The values at points that lie close together
    ///
    /// # Panics
    /// When there are not as many values as points.
    fn values(&self, points: &[DVec3], part: Self::Part, values: &mut [f64]) {
        assert_eq!(points.len(), values.len(), "a value for each point");
        for (value, &point) in values.iter_mut().zip(points) {
            *value = self.value(point, part);
        }
    }

    /// The value at the center of a ball in which `of` holds, and a part that holds in the ball
    ///
    /// Values of the part are those of the whole field.
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

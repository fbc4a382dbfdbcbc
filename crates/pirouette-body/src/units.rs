//! Quantities whose units must not be confused.

use std::f64::consts::TAU;

/// Nominal stature in px: sizes given in px refer to photos in which the person has this height
///
/// A nominal pixel is one of such a photo, regardless of the resolution.
pub const NOMINAL_STATURE_PX: f64 = 800.0;

/// Rotation of the person since facing the camera, counter-clockwise seen from above
///
/// The person turns to their left: at 90 degrees the nose points to the right edge of the photo.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct TurnAngle {
    radians: f64,
}

impl TurnAngle {
    /// Converts from degrees, the unit in files
    pub fn from_degrees(degrees: f64) -> Self {
        Self::from_radians(degrees.to_radians())
    }

    /// Converts from radians
    pub fn from_radians(radians: f64) -> Self {
        Self { radians }
    }

    /// Returns the angle in degrees, the unit in files
    pub fn degrees(self) -> f64 {
        self.radians.to_degrees()
    }

    /// Returns the angle in radians
    pub fn radians(self) -> f64 {
        self.radians
    }

    /// Returns the equivalent angle within [0, 360) degrees
    pub fn wrapped(self) -> Self {
        Self::from_radians(self.radians.rem_euclid(TAU))
    }

    /// Returns the rotation from world directions (person at turn 0) to the room frame
    pub fn room_from_world(self) -> glam::DMat3 {
        glam::DMat3::from_rotation_y(self.radians)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn at_a_quarter_turn_the_nose_points_to_the_right_edge_of_the_photo() {
        let nose = TurnAngle::from_degrees(90.0).room_from_world() * DVec3::Z;
        assert!((nose - DVec3::X).length() < 1e-12);
    }

    #[test]
    fn wrapping_keeps_the_direction() {
        let turn = TurnAngle::from_degrees(-45.0).wrapped();
        assert!((turn.degrees() - 315.0).abs() < 1e-9);
    }
}

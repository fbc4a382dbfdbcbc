//! Radial distortion of lenses: straight lines of the room are bent in the photo.

use glam::{DMat2, DVec2};

/// The distortion of a lens in a photo of one size; points are relative to the middle of the photo, in px
///
/// A point at the radius `r`, in half heights of the photo, belongs to the pinhole camera's point at `r (1 + k r²)`:
/// positive coefficients `k` pull the corners of the photo inward (barrel), negative ones push them outward.
///
/// # Source
/// Devernay and Faugeras 2001, "Straight lines have to be straight", section 2: the first coefficient of Brown's model,
/// from the photo to the pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// The coefficient `k`
    pub coefficient: f64,
    /// Half of the photo's height, in px
    pub half_height_px: f64,
}

/// Smallest derivative of the radius of the pinhole camera by that of the photo, at the margin of lenses that push the
/// corners outward
const MIN_RATE: f64 = 0.1;

impl Lens {
    /// Returns the point of the pinhole camera for a point of the photo
    pub fn straighten(self, photo: DVec2) -> DVec2 {
        photo * (1.0 + self.coefficient * self.radius_squared(photo))
    }

    /// Returns the point of the photo for a point of the pinhole camera
    ///
    /// A lens with a negative coefficient shows nothing beyond some radius: such points move to that radius.
    pub fn bend(self, straight: DVec2) -> DVec2 {
        let radius = self.radius_squared(straight).sqrt();
        if self.coefficient == 0.0 || radius == 0.0 {
            return straight;
        }
        // The real root of the cubic equation r (1 + k r²) = radius
        let root = (3.0 * self.coefficient.abs()).sqrt();
        let argument = 1.5 * radius * root;
        let bent = if self.coefficient > 0.0 {
            2.0 / root * (argument.asinh() / 3.0).sinh()
        } else {
            2.0 / root * (argument.min(1.0).asin() / 3.0).sin()
        };
        straight * (bent / radius)
    }

    /// Returns the derivatives of [`Lens::bend`]
    pub fn bend_gradient(self, straight: DVec2) -> DMat2 {
        if self.coefficient == 0.0 {
            return DMat2::IDENTITY;
        }
        let photo = self.bend(straight) / self.half_height_px;
        // The inverse of the derivatives of `straighten`, (1 + k r²) I + 2 k p pᵀ
        let across = 1.0 + self.coefficient * photo.length_squared();
        let along = across + 2.0 * self.coefficient * photo.length_squared();
        let outer = DMat2::from_cols(photo * photo.x, photo * photo.y);
        let rank_one = outer * (2.0 * self.coefficient / along.max(MIN_RATE));
        (DMat2::IDENTITY - rank_one) * across.recip()
    }

    fn radius_squared(self, point: DVec2) -> f64 {
        (point / self.half_height_px).length_squared()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(coefficient: f64) -> Lens {
        Lens {
            coefficient,
            half_height_px: 500.0,
        }
    }

    #[test]
    fn a_barrel_pulls_points_inward() {
        // 400 px at the radius 0.8 belong to 400 (1 + 0.1 * 0.64) px.
        let bent = lens(0.1).bend(DVec2::new(0.0, 425.6));
        assert!((bent - DVec2::new(0.0, 400.0)).length() < 1e-9, "{bent}");
        assert_eq!(lens(0.0).bend(DVec2::new(3.0, -7.0)), DVec2::new(3.0, -7.0));
        assert_eq!(lens(0.1).bend(DVec2::ZERO), DVec2::ZERO);
    }

    #[test]
    fn bending_is_the_inverse_of_straightening() {
        for coefficient in [-0.1, -0.03, 0.02, 0.3] {
            let photo = DVec2::new(-210.0, 480.0);
            let straight = lens(coefficient).straighten(photo);
            let back = lens(coefficient).bend(straight);
            assert!((back - photo).length() < 1e-9, "{coefficient}: {back}");
        }
    }

    #[test]
    fn points_beyond_the_margin_of_a_pincushion_stay_finite() {
        // The largest radius is 1 / sqrt(3 * 0.2) = 1.29 half heights.
        let bent = lens(-0.2).bend(DVec2::new(2000.0, 0.0));
        assert!((bent.x - 500.0 / 0.6_f64.sqrt()).abs() < 1e-6, "{bent}");
        assert!(
            lens(-0.2)
                .bend_gradient(DVec2::new(2000.0, 0.0))
                .is_finite()
        );
    }

    #[test]
    fn gradients_match_finite_differences() {
        for coefficient in [-0.08, 0.0, 0.15] {
            let (lens, at) = (lens(coefficient), DVec2::new(310.0, -270.0));
            let gradient = lens.bend_gradient(at);
            for axis in [DVec2::X, DVec2::Y] {
                let h = axis * 1e-3;
                let difference = (lens.bend(at + h) - lens.bend(at - h)) / 2e-3;
                assert!((gradient * axis - difference).length() < 1e-8);
            }
        }
    }
}

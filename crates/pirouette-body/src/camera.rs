//! The static pinhole camera in front of which the person turns.
//!
//! The *room* frame is the world frame (millimeters, y up, origin on the floor on the turning axis) fixed to the
//! camera; the person turns in it. The camera stands on the +z axis and looks along -z, unless it is pitched or yawed.

use glam::{DMat2, DVec2, DVec3};

use crate::lens::Lens;

/// A pinhole camera on the +z axis of the room
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Columns of the photo
    pub width_px: usize,
    /// Rows of the photo
    pub height_px: usize,
    /// Vertical field of view
    pub vertical_fov_radians: f64,
    /// Height of the center of projection above the floor, in mm
    pub height_mm: f64,
    /// Distance of the center of projection from the turning axis, in mm
    pub distance_mm: f64,
    /// Pitch; positive looks down
    pub pitch_radians: f64,
    /// Yaw; positive looks to the right of the turning axis, towards +x
    pub yaw_radians: f64,
    /// Radial distortion: the coefficient of the [`Lens`]
    pub distortion: f64,
}

impl Camera {
    /// Returns the same camera with the photo size of another camera
    pub fn with_size_of(self, other: &Self) -> Self {
        Self {
            width_px: other.width_px,
            height_px: other.height_px,
            ..self
        }
    }

    /// Returns the focal length in pixels
    pub fn focal_px(&self) -> f64 {
        self.height_px as f64 / (2.0 * (self.vertical_fov_radians / 2.0).tan())
    }

    /// Returns the center of projection in the room, in mm
    pub fn center(&self) -> DVec3 {
        DVec3::new(0.0, self.height_mm, self.distance_mm)
    }

    /// Returns the unit direction in the room of the photo's rows, to the right
    pub fn right(&self) -> DVec3 {
        self.projector().right()
    }

    /// Returns the same camera with `scale` times as many columns and rows, at least one of each
    pub fn scaled(&self, scale: f64) -> Self {
        let scaled = |size: usize| ((size as f64 * scale).round() as usize).max(1);
        Self {
            width_px: scaled(self.width_px),
            height_px: scaled(self.height_px),
            ..*self
        }
    }

    /// Precomputes the trigonometry for projecting many points
    pub fn projector(&self) -> Projector {
        let (sin, cos) = self.pitch_radians.sin_cos();
        let (yaw_sin, yaw_cos) = self.yaw_radians.sin_cos();
        Projector {
            height_mm: self.height_mm,
            distance_mm: self.distance_mm,
            sin,
            cos,
            yaw_sin,
            yaw_cos,
            focal_px: self.focal_px(),
            middle: DVec2::new(self.width_px as f64 / 2.0, self.height_px as f64 / 2.0),
            lens: self.lens(),
        }
    }

    /// Returns the lens
    pub fn lens(&self) -> Lens {
        Lens {
            coefficient: self.distortion,
            half_height_px: self.height_px as f64 / 2.0,
        }
    }

    /// Transforms a room point to the camera's view frame (x right, y down, z forward, in mm)
    pub fn view_from_room(&self, point: DVec3) -> DVec3 {
        self.projector().view_from_room(point)
    }

    /// Returns the depth of a room point along the optical axis, in mm; positive in front of the camera
    pub fn depth(&self, point: DVec3) -> f64 {
        self.view_from_room(point).z
    }

    /// Projects a room point to photo coordinates, in px
    ///
    /// Meaningless for points at or behind the camera; see [`Camera::depth`].
    pub fn project(&self, point: DVec3) -> DVec2 {
        self.projector().project(point)
    }

    /// Returns the gradients of photo x and photo y with respect to the room point, in px per mm
    pub fn project_gradients(&self, point: DVec3) -> [DVec3; 2] {
        self.projector().project_gradients(point)
    }

    /// Returns the derivatives of the photo point of a room point by its position in the photo of a lens without
    /// distortion
    pub fn lens_gradient(&self, point: DVec3) -> DMat2 {
        let view = self.view_from_room(point);
        let straight = view.truncate() * (self.focal_px() / view.z);
        self.lens().bend_gradient(straight)
    }

    /// Returns the unit direction in the room of the ray through a photo point
    pub fn ray(&self, photo: DVec2) -> DVec3 {
        let projector = self.projector();
        let focal = self.focal_px();
        let at = projector.lens.straighten(photo - projector.middle) / focal;
        let room = projector.right() * at.x + projector.down() * at.y + projector.ahead();
        room / room.length()
    }
}

/// A camera with precomputed trigonometry, for projecting many points
#[derive(Debug, Clone, Copy)]
pub struct Projector {
    height_mm: f64,
    distance_mm: f64,
    sin: f64,
    cos: f64,
    yaw_sin: f64,
    yaw_cos: f64,
    focal_px: f64,
    middle: DVec2,
    lens: Lens,
}

impl Projector {
    /// Like [`Camera::view_from_room`]
    pub fn view_from_room(&self, point: DVec3) -> DVec3 {
        let (sin, cos) = (self.sin, self.cos);
        let up = point.y - self.height_mm;
        let along = self.distance_mm - point.z;
        let right = point.x * self.yaw_cos - along * self.yaw_sin;
        let ahead = point.x * self.yaw_sin + along * self.yaw_cos;
        DVec3::new(right, -(up * cos) - ahead * sin, ahead * cos - up * sin)
    }

    /// First row of the rotation of `view_from_room`
    fn right(&self) -> DVec3 {
        DVec3::new(self.yaw_cos, 0.0, self.yaw_sin)
    }

    /// Its second row
    fn down(&self) -> DVec3 {
        let (sin, cos) = (self.sin, self.cos);
        DVec3::new(-self.yaw_sin * sin, -cos, self.yaw_cos * sin)
    }

    /// Its third row
    fn ahead(&self) -> DVec3 {
        let (sin, cos) = (self.sin, self.cos);
        DVec3::new(self.yaw_sin * cos, -sin, -self.yaw_cos * cos)
    }

    /// Like [`Camera::project`]
    pub fn project(&self, point: DVec3) -> DVec2 {
        self.photo_from_view(self.view_from_room(point))
    }

    /// Projects a point in the view frame to photo coordinates, in px
    pub fn photo_from_view(&self, view: DVec3) -> DVec2 {
        let straight = view.truncate() * (self.focal_px / view.z);
        self.middle + self.lens.bend(straight)
    }

    /// Like [`Camera::project_gradients`]
    pub fn project_gradients(&self, point: DVec3) -> [DVec3; 2] {
        let view = self.view_from_room(point);
        let scale = self.focal_px / view.z;
        let (x_axis, y_axis, z_axis) = (self.right(), self.down(), self.ahead());
        let straight = [
            (x_axis - z_axis * (view.x / view.z)) * scale,
            (y_axis - z_axis * (view.y / view.z)) * scale,
        ];
        if self.lens.coefficient == 0.0 {
            return straight;
        }
        let bend = self.lens.bend_gradient(view.truncate() * scale);
        [bend.row(0), bend.row(1)].map(|row| straight[0] * row.x + straight[1] * row.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            width_px: 800,
            height_px: 1000,
            vertical_fov_radians: 0.8,
            height_mm: 900.0,
            distance_mm: 2400.0,
            pitch_radians: 0.1,
            yaw_radians: -0.2,
            distortion: 0.1,
        }
    }

    #[test]
    fn a_level_camera_projects_by_the_pinhole_formula() {
        let level = Camera {
            pitch_radians: 0.0,
            yaw_radians: 0.0,
            distortion: 0.0,
            ..camera()
        };
        let p = DVec3::new(120.0, 1500.0, 80.0);
        let scale = level.focal_px() / (2400.0 - 80.0);
        let expected = DVec2::new(400.0 + scale * 120.0, 500.0 - scale * 600.0);
        assert!((level.project(p) - expected).length() < 1e-9);
    }

    #[test]
    fn looking_down_moves_points_ahead_up_in_the_photo() {
        let ahead = DVec3::new(0.0, 900.0, 0.0);
        assert!(camera().project(ahead).y < 500.0);
    }

    #[test]
    fn looking_to_the_right_moves_points_ahead_to_the_left() {
        let ahead = DVec3::new(0.0, 900.0, 0.0);
        let yawed = |yaw_radians| Camera {
            pitch_radians: 0.0,
            yaw_radians,
            distortion: 0.0,
            ..camera()
        };
        let x = yawed(0.2).project(ahead).x;
        let expected = 400.0 - camera().focal_px() * 0.2_f64.tan();
        assert!((x - expected).abs() < 1e-9);
        assert!((yawed(0.2).right().dot(DVec3::X) - 0.2_f64.cos()).abs() < 1e-12);
    }

    #[test]
    fn gradients_match_finite_differences() {
        let camera = camera();
        let p = DVec3::new(120.0, 1500.0, 80.0);
        let [gx, gy] = camera.project_gradients(p);
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let d = (camera.project(p + axis * 1e-3) - camera.project(p - axis * 1e-3)) / 2e-3;
            assert!((d.x - gx.dot(axis)).abs() < 1e-6);
            assert!((d.y - gy.dot(axis)).abs() < 1e-6);
        }
    }

    #[test]
    fn the_ray_through_a_projection_hits_the_point() {
        let camera = camera();
        let p = DVec3::new(-200.0, 300.0, 150.0);
        let to_point = p - camera.center();
        let ray = camera.ray(camera.project(p));
        assert!((ray * to_point.length() - to_point).length() < 1e-6);
    }
}

//! The expected position of a tape: its plane, and its convex curve in that plane.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use pirouette_geom::section::{convex_hull, perimeter};

use super::landmarks::Section;
use pirouette_body::{Avatar, Bone, PosedBones, SkinWeight};

/// The expected convex curve of a tape, in its plane
#[derive(Debug, Clone)]
pub(super) struct Tape {
    /// A point inside
    center: DVec3,
    /// Axes of the plane
    u: DVec3,
    v: DVec3,
    /// Convex hull of the section around the center, counter-clockwise
    hull: Vec<DVec2>,
    /// The surface below it, for moving with poses: vertices of the avatar and their weights
    carriers: Vec<(DVec3, SkinWeight)>,
    /// Change of the tape's length per mm of displacement
    girth_slope: f64,
}

impl Tape {
    /// Creates the tape along a section of an avatar; `None` if its area is zero
    pub(super) fn of_section(section: &Section, avatar: &Avatar) -> Option<Self> {
        let carriers = section.vertices.iter().filter_map(|&v| {
            let position = avatar.mesh.positions.get(v as usize)?;
            Some((*position, *avatar.weights.get(v as usize)?))
        });
        let tape = Self::new(&section.points, section.plane.normal, carriers.collect())?;
        Some(Self {
            girth_slope: section.girth_slope,
            ..tape
        })
    }

    /// Creates the tape around points, in the plane through their middle with this `normal`
    pub(super) fn new(
        points: &[DVec3],
        normal: DVec3,
        carriers: Vec<(DVec3, SkinWeight)>,
    ) -> Option<Self> {
        let normal = normal.try_normalize()?;
        let (u, v) = normal.any_orthonormal_pair();
        let mean = points.iter().sum::<DVec3>() / points.len() as f64;
        let flat = |p: &DVec3| DVec2::new((*p - mean).dot(u), (*p - mean).dot(v));
        let mut hull = convex_hull(&points.iter().map(flat).collect::<Vec<_>>());
        if hull.len() < 3 {
            return None;
        }
        // The mean is biased to where the section has many points; the middle of the hull is not.
        let middle = hull.iter().sum::<DVec2>() / hull.len() as f64;
        for p in &mut hull {
            *p -= middle;
        }
        Some(Self {
            center: mean + u * middle.x + v * middle.y,
            u,
            v,
            hull,
            carriers,
            girth_slope: 0.0,
        })
    }

    /// Returns the same tape at another position
    pub(super) fn moved(&self, by: DVec3) -> Self {
        Self {
            center: self.center + by,
            ..self.clone()
        }
    }

    /// Returns a point inside the tape
    pub(super) fn center(&self) -> DVec3 {
        self.center
    }

    /// Returns the unit normal of the plane
    pub(super) fn normal(&self) -> DVec3 {
        self.u.cross(self.v)
    }

    /// Returns the length of the expected tape, in mm
    pub(super) fn girth(&self) -> f64 {
        perimeter(&self.hull)
    }

    /// Returns the change of its length per mm of displacement
    pub(super) fn girth_slope(&self) -> f64 {
        self.girth_slope
    }

    /// Returns the convex hull around the center, counter-clockwise in the plane
    pub(super) fn hull(&self) -> &[DVec2] {
        &self.hull
    }

    /// Returns the hull in space
    pub(super) fn points(&self) -> Vec<DVec3> {
        self.hull.iter().map(|&p| self.lift(p)).collect()
    }

    /// Returns the distance from the center of the support line with this outward normal
    pub(super) fn support(&self, normal: DVec2) -> f64 {
        self.hull
            .iter()
            .map(|p| p.dot(normal))
            .fold(f64::NEG_INFINITY, f64::max)
    }

    pub(super) fn lift(&self, point: DVec2) -> DVec3 {
        self.center + self.u * point.x + self.v * point.y
    }

    pub(super) fn flatten(&self, direction: DVec3) -> DVec2 {
        DVec2::new(direction.dot(self.u), direction.dot(self.v))
    }

    /// Computes the rigid motion from the reference pose into the room of the tissue below the tape
    pub(super) fn room_from_reference(&self, posed: &PosedBones) -> DAffine3 {
        let mut sum = [0.0; 4];
        let mut first: Option<DQuat> = None;
        let (mut from, mut to) = (DVec3::ZERO, DVec3::ZERO);
        for (position, weight) in &self.carriers {
            let transform = posed.blend(weight);
            from += *position;
            to += transform.transform_point3(*position);
            for (bone, share) in weight.iter() {
                let turn = DQuat::from_mat3(&posed.transforms[bone].matrix3);
                // A quaternion and its negative are the same rotation.
                let same = *first.get_or_insert(turn);
                let sign = if same.dot(turn) < 0.0 { -share } else { share };
                for (s, q) in sum.iter_mut().zip(turn.to_array()) {
                    *s += sign * q;
                }
            }
        }
        let length = sum.iter().map(|s| s * s).sum::<f64>().sqrt();
        if length.is_nan() || length <= 0.0 {
            return posed.transforms[Bone::Root];
        }
        let rotation = DMat3::from_quat(DQuat::from_array(sum.map(|s| s / length)));
        let count = self.carriers.len() as f64;
        DAffine3 {
            matrix3: rotation,
            translation: to / count - rotation * (from / count),
        }
    }
}

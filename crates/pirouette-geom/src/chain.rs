//! Kinematic chains in the plane: consecutive bones, one angle each, and the rigid motions of the bones.
//!
//! Positive angles turn from x to y: clockwise on screen, where y points down.

use glam::DVec2;

/// A rigid motion of the plane: a rotation about the origin, then a translation
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidMotion {
    /// Positive from x to y
    pub rotation_radians: f64,
    /// Image of the origin
    pub translation: DVec2,
}

impl RigidMotion {
    /// The identity
    pub const IDENTITY: RigidMotion = RigidMotion {
        rotation_radians: 0.0,
        translation: DVec2::ZERO,
    };

    /// Returns the rotation about a point, followed by a translation
    ///
    /// # Examples
    /// ```
    /// use glam::DVec2;
    /// use pirouette_geom::chain::RigidMotion;
    /// let quarter = std::f64::consts::FRAC_PI_2;
    /// let motion = RigidMotion::about(DVec2::new(1.0, 0.0), quarter, DVec2::new(0.0, 5.0));
    /// assert!(motion.apply(DVec2::new(2.0, 0.0)).distance(DVec2::new(1.0, 6.0)) < 1e-12);
    /// ```
    pub fn about(center: DVec2, rotation_radians: f64, shift: DVec2) -> Self {
        let turned = DVec2::from_angle(rotation_radians).rotate(center);
        Self {
            rotation_radians,
            translation: center - turned + shift,
        }
    }

    /// Transforms a point
    pub fn apply(&self, point: DVec2) -> DVec2 {
        DVec2::from_angle(self.rotation_radians).rotate(point) + self.translation
    }

    /// Returns this motion followed by another
    #[must_use]
    pub fn then(&self, next: &RigidMotion) -> Self {
        Self {
            rotation_radians: self.rotation_radians + next.rotation_radians,
            translation: next.apply(self.translation),
        }
    }

    /// Returns the inverse motion
    #[must_use]
    pub fn inverse(&self) -> Self {
        let back = DVec2::from_angle(-self.rotation_radians);
        Self {
            rotation_radians: -self.rotation_radians,
            translation: -back.rotate(self.translation),
        }
    }
}

/// One bone of a chain
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChainBone {
    /// From its head, at the root side, to its tip
    pub length: f64,
    /// Angle to the previous bone; for the first bone, to the x axis
    pub angle_radians: f64,
}

/// Consecutive bones from a root to a tip
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Head of the first bone
    pub root: DVec2,
    /// From the root to the tip
    pub bones: Vec<ChainBone>,
}

impl Chain {
    /// Creates the chain through consecutive joints, root first
    ///
    /// A bone of zero length takes the previous bone's direction. Without joints, there are no bones, at the origin.
    pub fn from_joints(joints: &[DVec2]) -> Self {
        let mut before = 0.0;
        let bones = joints
            .windows(2)
            .map(|ends| {
                let bone = ends[1] - ends[0];
                let direction = if bone == DVec2::ZERO {
                    before
                } else {
                    bone.to_angle()
                };
                let angle_radians = direction - before;
                before = direction;
                ChainBone {
                    length: bone.length(),
                    angle_radians,
                }
            })
            .collect();
        Self {
            root: joints.first().copied().unwrap_or_default(),
            bones,
        }
    }

    /// Forward kinematics: returns the heads of all bones and the tip, one point more than bones
    pub fn joints(&self) -> Vec<DVec2> {
        let mut joints = Vec::with_capacity(self.bones.len() + 1);
        let (mut at, mut direction) = (self.root, 0.0);
        joints.push(at);
        for bone in &self.bones {
            direction += bone.angle_radians;
            at += bone.length * DVec2::from_angle(direction);
            joints.push(at);
        }
        joints
    }

    /// Returns the chain with an angle added to each bone; missing angles count as zero
    ///
    /// All later bones turn along.
    #[must_use]
    pub fn bent(&self, angles_radians: &[f64]) -> Self {
        let mut chain = self.clone();
        for (bone, angle) in chain.bones.iter_mut().zip(angles_radians) {
            bone.angle_radians += angle;
        }
        chain
    }

    /// Returns one motion per bone, which carries points fixed to the bone in `rest` to its current pose
    ///
    /// The chains have the same bones; lengths may differ; heads are mapped to heads.
    pub fn motions_from(&self, rest: &Chain) -> Vec<RigidMotion> {
        let mut rotation = 0.0;
        let heads = rest.joints().into_iter().zip(self.joints());
        rest.bones
            .iter()
            .zip(&self.bones)
            .zip(heads)
            .map(|((rest_bone, bone), (rest_head, head))| {
                rotation += bone.angle_radians - rest_bone.angle_radians;
                RigidMotion::about(rest_head, rotation, head - rest_head)
            })
            .collect()
    }

    /// Returns the derivative of a point fixed to one bone by each angle, one vector per bone, per radian
    ///
    /// Zero for the bones after `bone`, which do not move it.
    pub fn jacobian(&self, bone: usize, point: DVec2) -> Vec<DVec2> {
        self.joints()
            .iter()
            .take(self.bones.len())
            .enumerate()
            .map(|(i, &head)| {
                if i <= bone {
                    (point - head).perp()
                } else {
                    DVec2::ZERO
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn point() -> impl Strategy<Value = DVec2> {
        (-50.0..50.0f64, -50.0..50.0f64).prop_map(|(x, y)| DVec2::new(x, y))
    }

    #[test]
    fn bending_the_elbow_does_not_move_the_upper_arm() {
        let arm = Chain::from_joints(&[DVec2::ZERO, DVec2::new(3.0, 0.0), DVec2::new(5.0, 0.0)]);
        let joints = arm.bent(&[0.0, FRAC_PI_2]).joints();
        assert!(joints[1].distance(DVec2::new(3.0, 0.0)) < 1e-12);
        assert!(joints[2].distance(DVec2::new(3.0, 2.0)) < 1e-12);
        let joints = arm.bent(&[FRAC_PI_2]).joints();
        assert!(joints[2].distance(DVec2::new(0.0, 5.0)) < 1e-12);
    }

    #[test]
    fn degenerate_chains_are_handled() {
        assert_eq!(Chain::from_joints(&[]).joints(), [DVec2::ZERO]);
        let still = Chain::from_joints(&[DVec2::ONE; 3]);
        assert_eq!(still.bent(&[1.0, 2.0, 3.0]).joints(), [DVec2::ONE; 3]);
        let lame = Chain::from_joints(&[DVec2::NAN, DVec2::ONE]);
        assert_eq!(lame.motions_from(&lame).len(), 1);
    }

    proptest! {
        #[test]
        fn joints_survive_a_round_trip(joints in prop::collection::vec(point(), 1..6)) {
            for (a, b) in Chain::from_joints(&joints).joints().iter().zip(&joints) {
                prop_assert!(a.distance(*b) < 1e-9);
            }
        }

        #[test]
        fn motions_map_joints_to_joints(
            joints in prop::collection::vec(point(), 2..6),
            angles in prop::collection::vec(-3.0..3.0f64, 5),
        ) {
            let rest = Chain::from_joints(&joints);
            let bent = rest.bent(&angles);
            let to = bent.joints();
            for (i, motion) in bent.motions_from(&rest).iter().enumerate() {
                prop_assert!(motion.apply(joints[i]).distance(to[i]) < 1e-9);
                prop_assert!(motion.apply(joints[i + 1]).distance(to[i + 1]) < 1e-9);
                prop_assert!(motion.inverse().apply(to[i]).distance(joints[i]) < 1e-9);
            }
        }

        #[test]
        fn jacobian_matches_differences(
            joints in prop::collection::vec(point(), 4),
            p in point(),
            bone in 0usize..3,
        ) {
            const STEP: f64 = 1e-5;
            let chain = Chain::from_joints(&joints);
            for (k, derivative) in chain.jacobian(bone, p).iter().enumerate() {
                let moved = |angle: f64| {
                    let mut angles = [0.0; 3];
                    angles[k] = angle;
                    chain.bent(&angles).motions_from(&chain)[bone].apply(p)
                };
                let difference = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
                prop_assert!(difference.distance(*derivative) < 1e-4);
            }
        }

        #[test]
        fn motions_compose(p in point(), a in point(), b in point(), t in -3.0..3.0f64, u in -3.0..3.0f64) {
            let first = RigidMotion::about(a, t, b);
            let next = RigidMotion::about(b, u, a);
            let both = first.then(&next);
            prop_assert!(both.apply(p).distance(next.apply(first.apply(p))) < 1e-9);
            prop_assert!(both.then(&both.inverse()).apply(p).distance(p) < 1e-9);
        }
    }
}

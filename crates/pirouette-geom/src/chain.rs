//! Kinematic chains in the plane: bones in a row, one angle each, and the rigid motions they carry.
//!
//! Angles turn from x to y: clockwise on screen, where y points down.

use glam::DVec2;

/// A rigid motion of the plane: a rotation about the origin, then a shift
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidMotion {
    /// From x to y
    pub rotation_radians: f64,
    /// Where the origin goes
    pub translation: DVec2,
}

impl RigidMotion {
    /// The motion that moves nothing
    pub const IDENTITY: RigidMotion = RigidMotion {
        rotation_radians: 0.0,
        translation: DVec2::ZERO,
    };

    /// Rotation about a point, then a shift
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

    /// Where a point goes
    pub fn apply(&self, point: DVec2) -> DVec2 {
        DVec2::from_angle(self.rotation_radians).rotate(point) + self.translation
    }

    /// This motion, followed by another
    #[must_use]
    pub fn then(&self, next: &RigidMotion) -> Self {
        Self {
            rotation_radians: self.rotation_radians + next.rotation_radians,
            translation: next.apply(self.translation),
        }
    }

    /// The motion back
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
    /// From its head, toward the root, to its tip
    pub length: f64,
    /// Angle to the bone before it; of the first bone: to the x axis
    pub angle_radians: f64,
}

/// Bones in a row, from a root to a tip
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Head of the first bone
    pub root: DVec2,
    /// From the root to the tip
    pub bones: Vec<ChainBone>,
}

impl Chain {
    /// The chain through joints in a row, root first
    ///
    /// A bone without length has the direction of the one before it. No joints give no bones at the origin.
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

    /// Forward kinematics: the heads of all bones and the tip, one more than bones
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

    /// The chain with an angle added to each bone; missing angles add nothing
    ///
    /// What hangs on a bone turns with it.
    #[must_use]
    pub fn bent(&self, angles_radians: &[f64]) -> Self {
        let mut chain = self.clone();
        for (bone, angle) in chain.bones.iter_mut().zip(angles_radians) {
            bone.angle_radians += angle;
        }
        chain
    }

    /// One motion per bone, that carries what is fixed to the bone in `rest` to where the bone is now
    ///
    /// The chains have the same bones; lengths may differ, heads meet heads.
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

    /// How a point fixed to one of the bones moves per radian of each angle, one vector per bone
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
    fn bending_the_elbow_leaves_the_upper_arm() {
        let arm = Chain::from_joints(&[DVec2::ZERO, DVec2::new(3.0, 0.0), DVec2::new(5.0, 0.0)]);
        let joints = arm.bent(&[0.0, FRAC_PI_2]).joints();
        assert!(joints[1].distance(DVec2::new(3.0, 0.0)) < 1e-12);
        assert!(joints[2].distance(DVec2::new(3.0, 2.0)) < 1e-12);
        let joints = arm.bent(&[FRAC_PI_2]).joints();
        assert!(joints[2].distance(DVec2::new(0.0, 5.0)) < 1e-12);
    }

    #[test]
    fn degenerate_chains_are_fine() {
        assert_eq!(Chain::from_joints(&[]).joints(), [DVec2::ZERO]);
        let still = Chain::from_joints(&[DVec2::ONE; 3]);
        assert_eq!(still.bent(&[1.0, 2.0, 3.0]).joints(), [DVec2::ONE; 3]);
        let lame = Chain::from_joints(&[DVec2::NAN, DVec2::ONE]);
        assert_eq!(lame.motions_from(&lame).len(), 1);
    }

    proptest! {
        #[test]
        fn joints_go_in_and_out(joints in prop::collection::vec(point(), 1..6)) {
            for (a, b) in Chain::from_joints(&joints).joints().iter().zip(&joints) {
                prop_assert!(a.distance(*b) < 1e-9);
            }
        }

        #[test]
        fn motions_carry_the_joints(
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
        fn motions_chain(p in point(), a in point(), b in point(), t in -3.0..3.0f64, u in -3.0..3.0f64) {
            let first = RigidMotion::about(a, t, b);
            let next = RigidMotion::about(b, u, a);
            let both = first.then(&next);
            prop_assert!(both.apply(p).distance(next.apply(first.apply(p))) < 1e-9);
            prop_assert!(both.then(&both.inverse()).apply(p).distance(p) < 1e-9);
        }
    }
}

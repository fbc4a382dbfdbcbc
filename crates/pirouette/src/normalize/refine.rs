//! Refinement: each arm and leg is bent at shoulder and elbow, or hip and knee, until its contour lies on
//! the reference contour.
//!
//! The refined joints are the targets of a second deformation. Only bending in the image plane is undone; a limb hidden
//! by the trunk has too little contour and is unchanged.

use glam::DVec2;
use pirouette_geom::chain::{Chain, RigidMotion};

use super::descent::{Softness, descend};
use super::parts::{Bones, Part};
use super::register::{ReferenceContourMap, offsets, scattered};
use pirouette_body::{Joint, PerJoint};

/// Joint positions in a silhouette, in px; `None` where unknown
pub type JointPositions = PerJoint<Option<DVec2>>;

/// Bones shorter than this have no reliable direction, in px
const MIN_BONE_PX: f64 = 2.0;

/// Parameters of the descent
const WALK: [Softness; 3] = [
    Softness {
        px: 1.0,
        rounds: 12,
    },
    Softness {
        px: 0.3,
        rounds: 12,
    },
    Softness {
        px: 0.1,
        rounds: 12,
    },
];

/// An arm or a leg, the person's own side
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub enum Limb {
    LeftArm,
    RightArm,
    LeftLeg,
    RightLeg,
}

impl Limb {
    /// All limbs
    pub const ALL: [Limb; 4] = [Limb::LeftArm, Limb::RightArm, Limb::LeftLeg, Limb::RightLeg];

    /// Returns the name used in files, in snake case
    pub fn name(self) -> &'static str {
        match self {
            Limb::LeftArm => "left_arm",
            Limb::RightArm => "right_arm",
            Limb::LeftLeg => "left_leg",
            Limb::RightLeg => "right_leg",
        }
    }

    /// Returns root, middle and end of the chain
    pub fn joints(self) -> [Joint; 3] {
        use Joint::*;
        match self {
            Limb::LeftArm => [LeftShoulder, LeftElbow, LeftWrist],
            Limb::RightArm => [RightShoulder, RightElbow, RightWrist],
            Limb::LeftLeg => [LeftHip, LeftKnee, LeftAnkle],
            Limb::RightLeg => [RightHip, RightKnee, RightAnkle],
        }
    }

    /// Returns the joints beyond the end of the chain that move with its last bone
    pub(super) fn carried(self) -> &'static [Joint] {
        use Joint::*;
        match self {
            Limb::LeftArm | Limb::RightArm => &[],
            Limb::LeftLeg => &[LeftBigToe, LeftSmallToe, LeftHeel],
            Limb::RightLeg => &[RightBigToe, RightSmallToe, RightHeel],
        }
    }
}

/// Range and resolution of the search
///
/// In each round, every combination of `2 * steps_each_way + 1` angles of either bone around the current best is tried;
/// then the step shrinks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineOptions {
    /// Number of rounds
    pub rounds: usize,
    /// Number of candidates on each side of the current best
    pub steps_each_way: usize,
    /// Distance between angles in the first round, in radians
    pub step_radians: f64,
    /// Factor on the step after each round, below 1
    ///
    /// Closer to 1 escapes more local minima, but needs more rounds for the same precision.
    pub shrink: f64,
    /// Whether the best candidate is refined by descent on the distance map
    pub descend: bool,
    /// Contour points farther from their bone than this are ignored, in lengths of the limb
    ///
    /// Below 0.15 full thighs lose their contour; much above, the trunk's contour biases the limbs.
    pub reach: f64,
    /// Contour points nearer to the head of a bone than this are ignored, as are those equally near to the middle joint
    /// on the other side, in lengths of the bone
    ///
    /// There the skin follows both sides of the joint. Lower, the folds of elbow and knee bias the angles; higher, too
    /// little contour remains.
    pub joint_margin: f64,
    /// Limbs with fewer contour points per bone than this are unchanged
    pub min_points: usize,
    /// Gains of the mean distance below this leave the limb unchanged, in px
    ///
    /// Traced contours are uncertain by a few hundredths of a pixel; smaller gains are not significant.
    pub min_gain_px: f64,
}

impl Default for RefineOptions {
    /// 25 degrees each way at first, a degree between candidates at last, followed by descent
    fn default() -> Self {
        Self {
            rounds: 6,
            steps_each_way: 5,
            step_radians: 5f64.to_radians(),
            shrink: 0.72,
            descend: true,
            reach: 0.2,
            joint_margin: 0.15,
            min_points: 12,
            min_gain_px: 0.02,
        }
    }
}

/// Result for one limb
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimbRefinement {
    /// The limb
    pub limb: Limb,
    /// Rotation of the complete limb about shoulder or hip, from x to y (clockwise on screen)
    pub upper_radians: f64,
    /// Additional rotation of forearm or shin about elbow or knee
    pub lower_radians: f64,
    /// Mean distance of the limb's contour points to the reference contour before, in px
    pub mean_distance_before_px: f64,
    /// The same after; never larger than before
    pub mean_distance_after_px: f64,
    /// Numbers of contour points of upper arm or thigh, and of forearm and hand or shin and foot
    pub point_counts: [usize; 2],
}

/// Joints after refinement
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// All joints; those of refined limbs are moved
    pub joints: JointPositions,
    /// The limbs that could be searched, moved or not; limbs without joints or contour are missing
    pub limbs: Vec<LimbRefinement>,
}

/// Bends arms and legs to minimize the distance of their contour points to a reference contour
///
/// `contour` contains points of the registered silhouette and `joints` its joints, both in the pixels of the reference
/// view. Each contour point belongs to the nearest bone of the skeleton; the limbs use those of their own two bones,
/// with hand or foot. Limbs with a missing joint are skipped.
///
/// # Source
/// Zwettler et al. 2021, eq. 5 to 7, interpreted as: contour points of the first bone are rotated by alpha about the
/// chain's root (5), those of the second bone by alpha about the root and by beta about the middle joint (6); the
/// fitness is the mean of the reference contour's distance map at the limb's points (7); the search is that of the
/// registration. All combinations are tried, since rotating one angle at a time gets stuck where a wrong elbow
/// compensates a wrong shoulder; the final descent is our addition.
pub fn refine(
    contour: &[DVec2],
    joints: &JointPositions,
    reference: &ReferenceContourMap,
    options: &RefineOptions,
) -> Refinement {
    let known = joints.map(|joint| joint.filter(|p| p.is_finite()));
    let parts = assign(&scattered(contour), &known, options);
    let mut refined = *joints;
    let mut limbs = Vec::new();
    for (limb, points) in Limb::ALL.into_iter().zip(&parts) {
        let Some(chain) = limb_chain(limb, &known) else {
            continue;
        };
        if points.iter().any(|p| p.len() < options.min_points.max(1)) {
            continue;
        }
        let found = search(limb, &chain, points, reference, options);
        let bent = chain.bent(&[found.upper_radians, found.lower_radians]);
        let motions = bent.motions_from(&chain);
        for (joint, position) in limb.joints().into_iter().zip(bent.joints()) {
            refined[joint] = Some(position);
        }
        for &joint in limb.carried() {
            let moved = known[joint].map(|p| motions[LOWER].apply(p));
            refined[joint] = moved.or(joints[joint]);
        }
        limbs.push(found);
    }
    Refinement {
        joints: refined,
        limbs,
    }
}

const UPPER: usize = 0;
const LOWER: usize = 1;

/// Returns the chain of a limb, if its joints are known and distinct
fn limb_chain(limb: Limb, joints: &JointPositions) -> Option<Chain> {
    let [root, middle, end] = limb.joints().map(|joint| joints[joint]);
    let chain = Chain::from_joints(&[root?, middle?, end?]);
    let long_enough = chain.bones.iter().all(|bone| bone.length >= MIN_BONE_PX);
    long_enough.then_some(chain)
}

/// Searches the two angles of one limb
fn search(
    limb: Limb,
    chain: &Chain,
    points: &[Vec<DVec2>; 2],
    reference: &ReferenceContourMap,
    options: &RefineOptions,
) -> LimbRefinement {
    let total = |bone: usize, motion: &RigidMotion, limit: f64| {
        let turn = DVec2::from_angle(motion.rotation_radians);
        let turned: Vec<DVec2> = points[bone].iter().map(|&p| turn.rotate(p)).collect();
        reference.total_distance(&turned, motion.translation, limit)
    };
    let fitness = |angles: [f64; 2], limit: f64| {
        let motions = chain.bent(&angles).motions_from(chain);
        let upper = total(UPPER, &motions[UPPER], limit);
        upper + total(LOWER, &motions[LOWER], limit - upper)
    };
    let before = fitness([0.0; 2], f64::INFINITY);
    let mut best = ([0.0; 2], before);
    let mut step = options.step_radians;
    for _ in 0..options.rounds {
        let ([start_upper, start_lower], _) = best;
        for i in offsets(options.steps_each_way) {
            for k in offsets(options.steps_each_way) {
                let angles = [start_upper + i * step, start_lower + k * step];
                let found = fitness(angles, best.1);
                if found < best.1 {
                    best = (angles, found);
                }
            }
        }
        step *= options.shrink;
    }
    if options.descend {
        let (angles, _) = descend(best.0, &WALK, |angles, pull| {
            let bent = chain.bent(angles);
            let motions = bent.motions_from(chain);
            let joints = bent.joints();
            for (bone, motion) in motions.iter().enumerate() {
                let turn = DVec2::from_angle(motion.rotation_radians);
                for &point in &points[bone] {
                    let place = turn.rotate(point) + motion.translation;
                    if let Some((distance, slope)) = reference.signed_with_slope(place) {
                        let upper = slope.dot((place - joints[UPPER]).perp());
                        let lower = match bone {
                            UPPER => 0.0,
                            _ => slope.dot((place - joints[LOWER]).perp()),
                        };
                        pull.add(distance, [upper, lower]);
                    }
                }
            }
        });
        let found = fitness(angles, best.1);
        if found < best.1 {
            best = (angles, found);
        }
    }
    let count = (points[UPPER].len() + points[LOWER].len()) as f64;
    if before - best.1 < options.min_gain_px * count {
        best = ([0.0; 2], before);
    }
    let ([upper_radians, lower_radians], after) = best;
    LimbRefinement {
        limb,
        upper_radians,
        lower_radians,
        mean_distance_before_px: before / count,
        mean_distance_after_px: after / count,
        point_counts: [points[UPPER].len(), points[LOWER].len()],
    }
}

/// Collects the contour points of each limb, by bone
fn assign(
    points: &[DVec2],
    joints: &JointPositions,
    options: &RefineOptions,
) -> [[Vec<DVec2>; 2]; 4] {
    let bones = Bones::new(joints);
    let limits = Limb::ALL.map(|limb| {
        let chain = limb_chain(limb, joints);
        chain.map_or(0.0, |c| {
            options.reach * c.bones.iter().map(|b| b.length).sum::<f64>()
        })
    });
    let mut parts: [[Vec<DVec2>; 2]; 4] = Default::default();
    for &point in points {
        let Some(nearest) = bones.nearest(point) else {
            continue;
        };
        let Some((limb, part)) = nearest.owner else {
            continue;
        };
        let (distance, t) = (nearest.distance, nearest.along);
        let margin = options.joint_margin;
        let (bone, at_joint) = match part {
            Part::Upper => (UPPER, t <= margin || t >= 1.0 - margin),
            Part::Lower => (LOWER, t <= margin),
            Part::End => (LOWER, false),
        };
        if !at_joint && distance <= limits[limb as usize] {
            parts[limb as usize][bone].push(point);
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_geom::Grid;
    use pirouette_geom::contour::trace_outline;
    use pirouette_geom::coverage::fill_polygons;

    /// A round-ended, tapered bone as a polygon
    fn capsule(from: DVec2, to: DVec2, radius_from: f64, radius_to: f64) -> Vec<DVec2> {
        let out = (to - from).try_normalize().unwrap_or(DVec2::X);
        (0..64)
            .map(|i| std::f64::consts::PI * (f64::from(i) + 0.5) / 32.0)
            .map(|t| {
                let ray = DVec2::from_angle(t).rotate(out);
                if t.cos() > 0.0 {
                    to + radius_to * ray
                } else {
                    from + radius_from * ray
                }
            })
            .collect()
    }

    /// Joints of a standing stick figure, 400 px high, arms slightly out
    fn standing() -> JointPositions {
        use Joint::*;
        let mut joints = PerJoint::splat(None);
        for (joint, x, y) in [
            (Nose, 200.0, 60.0),
            (Neck, 200.0, 105.0),
            (RightShoulder, 160.0, 110.0),
            (RightElbow, 122.0, 175.0),
            (RightWrist, 90.0, 232.0),
            (LeftShoulder, 240.0, 110.0),
            (LeftElbow, 278.0, 175.0),
            (LeftWrist, 310.0, 232.0),
            (MidHip, 200.0, 245.0),
            (RightHip, 178.0, 248.0),
            (RightKnee, 170.0, 340.0),
            (RightAnkle, 163.0, 432.0),
            (LeftHip, 222.0, 248.0),
            (LeftKnee, 230.0, 340.0),
            (LeftAnkle, 237.0, 432.0),
            (LeftBigToe, 250.0, 446.0),
        ] {
            joints[joint] = Some(DVec2::new(x, y));
        }
        joints
    }

    fn draw(joints: &JointPositions) -> Grid<f32> {
        let at = |joint: Joint| joints[joint].unwrap();
        let mut parts = vec![
            capsule(at(Joint::Neck), at(Joint::MidHip), 36.0, 36.0),
            capsule(at(Joint::Neck), at(Joint::Nose), 18.0, 24.0),
        ];
        for limb in Limb::ALL {
            let [root, middle, end] = limb.joints().map(at);
            let thick = matches!(limb, Limb::LeftLeg | Limb::RightLeg);
            let [a, b, c] = if thick {
                [20.0, 14.0, 9.0]
            } else {
                [12.0, 9.0, 6.0]
            };
            parts.push(capsule(root, middle, a, b));
            parts.push(capsule(middle, end, b, c));
        }
        fill_polygons(400, 480, &parts)
    }

    /// The stick figure with limbs bent by degrees at root and middle joint
    fn bend(joints: &JointPositions, bends: &[(Limb, f64, f64)]) -> JointPositions {
        let mut bent = *joints;
        for &(limb, upper, lower) in bends {
            let chain = limb_chain(limb, joints).unwrap();
            let moved = chain.bent(&[upper.to_radians(), lower.to_radians()]);
            for (joint, p) in limb.joints().into_iter().zip(moved.joints()) {
                bent[joint] = Some(p);
            }
        }
        bent
    }

    fn contour_of(coverage: &Grid<f32>) -> Vec<DVec2> {
        let outline = trace_outline(coverage, 0.5);
        outline.into_iter().flat_map(|c| c.points).collect()
    }

    #[test]
    fn aligned_limbs_do_not_move() {
        let joints = standing();
        let coverage = draw(&joints);
        let reference = ReferenceContourMap::from_coverage(&coverage);
        let found = refine(
            &contour_of(&coverage),
            &joints,
            &reference,
            &RefineOptions::default(),
        );
        assert_eq!(found.limbs.len(), 4);
        for limb in &found.limbs {
            assert_eq!(
                (limb.upper_radians, limb.lower_radians),
                (0.0, 0.0),
                "{limb:?}"
            );
        }
        for (a, b) in found.joints.iter().zip(&joints) {
            assert!(a.is_some() == b.is_some());
            if let (Some(a), Some(b)) = (a, b) {
                assert!(a.distance(*b) < 1e-9);
            }
        }
    }

    #[test]
    fn bends_beyond_the_first_round_are_found_or_unchanged() {
        let joints = standing();
        let target = bend(&joints, &[(Limb::LeftArm, -60.0, 20.0)]);
        let reference = ReferenceContourMap::from_coverage(&draw(&target));
        let contour = contour_of(&draw(&joints));
        let found = refine(&contour, &joints, &reference, &RefineOptions::default());
        for limb in found.limbs {
            assert!(limb.mean_distance_after_px <= limb.mean_distance_before_px);
        }
    }

    #[test]
    fn known_bends_are_found() {
        let bends = [
            (Limb::LeftArm, -14.0, 9.0),
            (Limb::RightArm, 7.3, -12.6),
            (Limb::LeftLeg, 3.1, -2.2),
            (Limb::RightLeg, -4.7, 6.0),
        ];
        let joints = standing();
        let target = bend(&joints, &bends);
        let reference = ReferenceContourMap::from_coverage(&draw(&target));
        let contour = contour_of(&draw(&joints));
        let found = refine(&contour, &joints, &reference, &RefineOptions::default());
        assert_eq!(found.limbs.len(), 4);
        for limb in &found.limbs {
            let (_, upper, lower) = *bends.iter().find(|b| b.0 == limb.limb).unwrap();
            for (found, bend) in [(limb.upper_radians, upper), (limb.lower_radians, lower)] {
                assert!((found.to_degrees() - bend).abs() < 0.03, "{bend}: {limb:?}");
            }
            assert!(limb.mean_distance_after_px < 0.2);
        }
        for (joint, found) in found.joints.pairs() {
            if let (Some(found), Some(truth)) = (found, target[joint]) {
                let carried = joint == Joint::LeftBigToe;
                assert!(carried || found.distance(truth) < 0.05, "{joint:?}");
            }
        }
    }

    #[test]
    fn missing_joints_skip_their_limb() {
        let joints = standing();
        let coverage = draw(&joints);
        let reference = ReferenceContourMap::from_coverage(&coverage);
        let mut holey = joints;
        holey[Joint::LeftElbow] = None;
        holey[Joint::RightHip] = Some(DVec2::NAN);
        let found = refine(
            &contour_of(&coverage),
            &holey,
            &reference,
            &RefineOptions::default(),
        );
        let limbs: Vec<Limb> = found.limbs.iter().map(|l| l.limb).collect();
        assert_eq!(limbs, [Limb::RightArm, Limb::LeftLeg]);
        assert_eq!(found.joints[Joint::LeftElbow], None);
        assert_eq!(found.joints[Joint::LeftWrist], joints[Joint::LeftWrist]);
    }

    #[test]
    fn non_finite_input_causes_no_motion() {
        let joints = standing();
        let contour = contour_of(&draw(&joints));
        let nothing = ReferenceContourMap::from_coverage(&Grid::filled(0, 0, 0.0));
        let options = RefineOptions::default();
        for limb in refine(&contour, &joints, &nothing, &options).limbs {
            assert_eq!((limb.upper_radians, limb.lower_radians), (0.0, 0.0));
        }
        let reference = ReferenceContourMap::from_coverage(&draw(&joints));
        assert!(refine(&[], &joints, &reference, &options).limbs.is_empty());
        assert!(
            refine(&[DVec2::NAN; 9], &joints, &reference, &options)
                .limbs
                .is_empty()
        );
        let collapsed = PerJoint::splat(Some(DVec2::splat(200.0)));
        let none = refine(&contour, &collapsed, &reference, &options);
        assert!(none.limbs.is_empty() && none.joints == collapsed);
        let far = PerJoint::splat(Some(DVec2::splat(f64::MAX)));
        assert!(
            refine(&contour, &far, &reference, &options)
                .limbs
                .is_empty()
        );
    }
}

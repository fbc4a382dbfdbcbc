//! Keypoint positions of a skinned body as a detector would place them.
//!
//! Limb joints are the heads of the bones. Face and feet points are found on the surface: detectors are trained on the
//! clicks of annotators, who mark noses and toes in photos, not bones.

use std::f64::consts::FRAC_PI_4;

use glam::{DVec2, DVec3};
use pirouette_geom::TriMesh;

use crate::{Bone, Joint, PerBone, PerJoint, SkinWeight};

/// Height range searched for the nose, as shares of the head's height from below
///
/// Above this range brows and hair protrude, below it the chin.
const NOSE_ZONE: [f64; 2] = [0.2, 0.6];

/// Number of heights at which the profile of the face is sampled: about every 2 mm
const NOSE_SAMPLES: u32 = 48;

/// Offset of the eyes above the nose and from the middle, as shares of the stature, for rigs without eyes
const EYE_ABOVE_NOSE: f64 = 0.016;
const EYE_BESIDE_MIDDLE: f64 = 0.018;

/// Distance from the middle of an eye to its lids and corners, as a share of the stature
const LID_RADIUS: f64 = 0.0065;

/// Half the height of the zone around the eyes in which ears protrude, as a share of the stature
const EAR_ZONE: f64 = 0.022;

/// Positions of the big and the small toe along the foot, as shares of its length from the heel
const BIG_TOE_ALONG: f64 = 0.88;
const SMALL_TOE_ALONG: f64 = 0.73;

/// Distances of the toes from the inner and the outer edge of the foot, as shares of its width there
const BIG_TOE_INSET: f64 = 0.2;
const SMALL_TOE_INSET: f64 = 0.06;

/// Position of the section through the heel whose middle is used, as a share of the foot's length
const HEEL_SECTION: f64 = 0.03;

/// Height of toes and heel above the floor, as a share of the stature
const FOOT_POINT_HEIGHT: f64 = 0.0128;

/// Finds all 25 keypoints, in mm, of a body that stands on the floor and faces +z
///
/// `eyes` are the centers of the left and the right eyeball, where known. For bodies without a head or feet, the points
/// on them fall back to the head of the bone.
pub(crate) fn find_keypoints(
    mesh: &TriMesh,
    weights: &[SkinWeight],
    heads: &PerBone<DVec3>,
    eyes: [Option<DVec3>; 2],
) -> PerJoint<DVec3> {
    let mut points = PerJoint::from_fn(|joint| heads[joint.bone()]);
    let head = |bone: Bone| heads[bone];
    points.set_middles(|left, right| (left + right) / 2.0);

    let stature = mesh.bounds().map_or(0.0, |(low, high)| high.y - low.y);
    let of_bone = |bone: Bone| -> Vec<DVec3> {
        let vertices = mesh.positions.iter().zip(weights);
        vertices
            .filter(|(_, w)| w.strongest() == bone)
            .map(|(&p, _)| p)
            .collect()
    };
    let skull = head(Bone::Head);
    if let Some(face) = Face::find(mesh, weights, &of_bone(Bone::Head), skull, stature, eyes) {
        points[Joint::Nose] = face.nose;
        [points[Joint::LeftEye], points[Joint::RightEye]] = face.eyes;
        [points[Joint::LeftEar], points[Joint::RightEar]] = face.ears;
    }
    for (bone, big, small, heel, outward) in [
        (
            Bone::LeftFoot,
            Joint::LeftBigToe,
            Joint::LeftSmallToe,
            Joint::LeftHeel,
            DVec3::X,
        ),
        (
            Bone::RightFoot,
            Joint::RightBigToe,
            Joint::RightSmallToe,
            Joint::RightHeel,
            -DVec3::X,
        ),
    ] {
        let foot = triangles_of(mesh, weights, bone);
        if let Some(found) = foot_points(&foot, head(bone), outward, stature) {
            [points[big], points[small], points[heel]] = found;
        }
    }
    points
}

struct Face {
    nose: DVec3,
    eyes: [DVec3; 2],
    ears: [DVec3; 2],
}

impl Face {
    fn find(
        mesh: &TriMesh,
        weights: &[SkinWeight],
        vertices: &[DVec3],
        head: DVec3,
        stature: f64,
        eyes: [Option<DVec3>; 2],
    ) -> Option<Self> {
        let low = vertices.iter().map(|p| p.y).reduce(f64::min)?;
        let high = vertices.iter().map(|p| p.y).reduce(f64::max)?;
        let at = |share: f64| low + share * (high - low);
        let faces = triangles_of(mesh, weights, Bone::Head);
        let nose = (0..=NOSE_SAMPLES)
            .filter_map(|i| {
                let share = f64::from(i) / f64::from(NOSE_SAMPLES);
                let y = at(NOSE_ZONE[0] + share * (NOSE_ZONE[1] - NOSE_ZONE[0]));
                Some(DVec3::new(head.x, y, surface_before(&faces, head.x, y)?))
            })
            .max_by(|a, b| a.z.total_cmp(&b.z))?;
        let side = |index: usize| if index == 0 { 1.0 } else { -1.0 };
        let eyes: [DVec3; 2] = std::array::from_fn(|i| {
            let guess =
                nose + DVec3::new(side(i) * EYE_BESIDE_MIDDLE, EYE_ABOVE_NOSE, 0.0) * stature;
            let eye = eyes[i].unwrap_or(guess);
            // Samples around the eye: bodies without eyeballs have hollows there.
            let mut lids: Vec<f64> = (0..8)
                .filter_map(|k| {
                    let (sin, cos) = (f64::from(k) * FRAC_PI_4).sin_cos();
                    let radius = LID_RADIUS * stature;
                    surface_before(&faces, eye.x + radius * cos, eye.y + radius * sin)
                })
                .filter(|&z| z > head.z)
                .collect();
            lids.sort_by(f64::total_cmp);
            let lid = lids.get(lids.len() / 2).copied();
            DVec3::new(eye.x, eye.y, lid.unwrap_or(nose.z))
        });
        let eye_level = (eyes[0].y + eyes[1].y) / 2.0;
        let ears: [DVec3; 2] = std::array::from_fn(|i| {
            let widest = |near_eyes: bool| {
                vertices
                    .iter()
                    .filter(|p| !near_eyes || (p.y - eye_level).abs() < EAR_ZONE * stature)
                    .copied()
                    .max_by(|a, b| (a.x * side(i)).total_cmp(&(b.x * side(i))))
            };
            // coarse heads have no vertices there
            let flat = || widest(false).map(|p| DVec3::new(p.x, eye_level, head.z));
            widest(true).or_else(flat).unwrap_or(head)
        });
        Some(Self { nose, eyes, ears })
    }
}

/// Collects the triangles that touch vertices of a bone
fn triangles_of(mesh: &TriMesh, weights: &[SkinWeight], bone: Bone) -> Vec<[DVec3; 3]> {
    let of_bone: Vec<bool> = weights.iter().map(|w| w.strongest() == bone).collect();
    (0..mesh.triangles.len())
        .filter(|&t| mesh.triangles[t].iter().any(|&v| of_bone[v as usize]))
        .map(|t| mesh.corners(t))
        .collect()
}

/// Returns the frontmost z of triangles on the line along z through `(x, y)`
fn surface_before(triangles: &[[DVec3; 3]], x: f64, y: f64) -> Option<f64> {
    let p = DVec2::new(x, y);
    triangles
        .iter()
        .filter_map(|corners| {
            let [a, b, c] = corners.map(|q| q.truncate());
            let area = (b - a).perp_dot(c - a);
            let weights = [
                (c - b).perp_dot(p - b) / area,
                (a - c).perp_dot(p - c) / area,
                (b - a).perp_dot(p - a) / area,
            ];
            // also false for triangles of zero area
            weights.iter().all(|&w| w >= 0.0).then(|| {
                let by_corner = corners.iter().zip(weights);
                by_corner.map(|(q, w)| q.z * w).sum::<f64>()
            })
        })
        .max_by(f64::total_cmp)
}

/// Finds big toe, small toe and heel
fn foot_points(
    triangles: &[[DVec3; 3]],
    ankle: DVec3,
    outward: DVec3,
    stature: f64,
) -> Option<[DVec3; 3]> {
    let low = || triangles.iter().flatten().filter(|p| p.y < ankle.y);
    let reach = |p: &DVec3| (p.x - ankle.x).hypot(p.z - ankle.z);
    let tip = low().max_by(|a, b| reach(a).total_cmp(&reach(b)))?;
    let forward = DVec3::new(tip.x - ankle.x, 0.0, tip.z - ankle.z).try_normalize()?;
    let across = (outward - forward * outward.dot(forward)).try_normalize()?;
    let along = |p: DVec3| (p - ankle).dot(forward);
    let rear = low().map(|&p| along(p)).reduce(f64::min)?;
    let front = low().map(|&p| along(p)).reduce(f64::max)?;
    let length = front - rear;
    // innermost and outermost point of a section across the foot
    let section = |share: f64| -> Option<(f64, f64)> {
        let at = rear + share * length;
        triangles
            .iter()
            .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
            .filter_map(|(p, q)| {
                let (dp, dq) = (along(p) - at, along(q) - at);
                let crossing = p.lerp(q, dp / (dp - dq));
                ((dp < 0.0) != (dq < 0.0) && crossing.y < ankle.y)
                    .then(|| (crossing - ankle).dot(across))
            })
            .fold(None, |range, x| {
                let (inner, outer) = range.unwrap_or((x, x));
                Some((inner.min(x), outer.max(x)))
            })
    };
    let place = |share: f64, side: f64| {
        let point = ankle + forward * (rear + share * length) + across * side;
        DVec3::new(point.x, FOOT_POINT_HEIGHT * stature, point.z)
    };
    let (inner, outer) = section(BIG_TOE_ALONG)?;
    let big_toe = place(BIG_TOE_ALONG, inner + BIG_TOE_INSET * (outer - inner));
    let (inner, outer) = section(SMALL_TOE_ALONG)?;
    let small_toe = place(SMALL_TOE_ALONG, outer - SMALL_TOE_INSET * (outer - inner));
    let (inner, outer) = section(HEEL_SECTION)?;
    let heel = place(0.0, (inner + outer) / 2.0);
    Some([big_toe, small_toe, heel])
}

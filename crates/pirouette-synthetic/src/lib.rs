//! Rendered people with ground truth: photos of a person who turns and sways in a furnished room, with noisy keypoints.
//!
//! For demonstrations, tests and studies. The renderer is accurate where it matters for silhouettes (exact coverage at
//! the outline, perspective, sensor noise), and simple elsewhere (one light, no cast shadows except around the feet).
//! The shape comes from an [`Avatar`], so it is only as realistic as that.

mod appearance;
pub mod people;
mod person;
mod random;
mod room;
mod sway;
pub mod video;
pub mod wardrobe;

pub use appearance::{Appearance, Lighting};
pub use random::Random;
pub use room::Clutter;
pub use wardrobe::{Dressed, Outfit, dress};

use glam::{DMat3, DVec2, DVec3};
use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Grid, Mask, TriMesh};

use pirouette::scan::{
    CameraSetup, KeypointKind, KeypointSource, Photo, STATED_TURN_SD_DEGREES, Scan, StatureFrom,
    Subject, View,
};
use pirouette_body::{
    Avatar, Bone, Camera, Joint, Keypoint, Keypoints, NOMINAL_STATURE_PX, PerJoint, Pose,
    PosedAvatar, PosedBones, TurnAngle, render,
};

/// Parameters of the photography of a person
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticOptions {
    /// Equal seeds give equal scans
    pub seed: u64,
    /// Turn angle of each view
    pub turns: Vec<TurnAngle>,
    /// The camera; the person stands at its turning axis
    pub camera: Camera,
    /// Sway relative to that of people who try to stand still; 0 disables it
    pub sway: f64,
    /// Standard deviation of visible keypoints, in px at a stature of 800 px; hidden ones have three times as much
    pub keypoint_noise_px: f64,
    /// Standard deviation of the true turn from the one stated in the scan, in radians
    pub turn_noise_radians: f64,
    /// Standard deviation of the sensor noise, in gray levels
    pub sensor_noise: f64,
    /// Furniture of the room
    pub clutter: Clutter,
    /// Whether photos are rendered; otherwise they are blank, and the exact silhouettes are given as masks
    pub photos: bool,
}

impl SyntheticOptions {
    /// Returns the turn angles of evenly spaced views over one turn
    pub fn even_turns(view_count: usize) -> Vec<TurnAngle> {
        (0..view_count)
            .map(|i| TurnAngle::from_degrees(360.0 * i as f64 / view_count as f64))
            .collect()
    }

    /// Returns a camera whose photos show a person of the given stature with a margin
    pub fn camera_for(stature_mm: f64, width_px: usize, height_px: usize) -> Camera {
        let vertical_fov_radians = 50_f64.to_radians();
        let aspect = (width_px as f64 / height_px as f64).min(0.8);
        // the arms of an A-pose span about 0.75 statures
        let seen = (stature_mm * 1.2).max(stature_mm * 0.95 / aspect);
        Camera {
            width_px,
            height_px,
            vertical_fov_radians,
            height_mm: stature_mm * 0.52,
            distance_mm: seen / (2.0 * (vertical_fov_radians / 2.0).tan()) + 0.1 * stature_mm,
            pitch_radians: 0.0,
            yaw_radians: 0.0,
            distortion: 0.0,
        }
    }
}

/// A scan with its ground truth
#[derive(Debug, Clone)]
pub struct SyntheticScan {
    /// The input available to a user: photos, keypoints, angles, camera height and field of view, stature
    pub scan: Scan,
    /// The ground truth, unknown to a user
    pub truth: Truth,
}

/// Ground truth of a rendered person
#[derive(Debug, Clone)]
pub struct Truth {
    /// The body in the reference pose, world frame, mm
    pub body: TriMesh,
    /// The camera
    pub camera: Camera,
    /// The pose in each view, relative to the turn angle stated in the scan
    pub poses: Vec<Pose>,
    /// The silhouette as photographed, of each view
    pub silhouettes: Vec<Mask>,
    /// The silhouette of the person standing still in the reference pose, of each view
    pub canonical: Vec<Mask>,
    /// The room without the person, if photos are rendered
    pub room: Option<Photo>,
}

/// Renders a scan of an avatar that turns and sways
pub fn synthesize(avatar: &Avatar, options: &SyntheticOptions) -> SyntheticScan {
    synthesize_in(avatar, options, &Appearance::default())
}

/// Like [`synthesize`], with a given tone of the skin and a given light
pub fn synthesize_in(
    avatar: &Avatar,
    options: &SyntheticOptions,
    appearance: &Appearance,
) -> SyntheticScan {
    let look = || person::Look::new(avatar, options.seed, appearance);
    photograph(avatar, avatar.stature_mm(), look, options, appearance)
}

/// Like [`synthesize_in`], of a dressed person: photos, silhouettes and [`Truth::body`] show clothes and hair
///
/// Keypoints are those of the body. The stated stature is that of the naked, barefoot body.
pub fn synthesize_dressed(
    dressed: &Dressed,
    options: &SyntheticOptions,
    appearance: &Appearance,
) -> SyntheticScan {
    let look = || person::Look::dressed(dressed, options.seed, appearance);
    let (avatar, stature_mm) = (&dressed.avatar, dressed.stature_mm);
    photograph(avatar, stature_mm, look, options, appearance)
}

fn photograph(
    avatar: &Avatar,
    stature_mm: f64,
    look: impl FnOnce() -> person::Look,
    options: &SyntheticOptions,
    appearance: &Appearance,
) -> SyntheticScan {
    let camera = options.camera;
    let lighting = appearance.lighting;
    let painted = options.photos.then(|| {
        let look = look();
        let mut background = room::Room::new(options.seed, options.clutter).render(&camera);
        lighting.light_room(&mut background);
        (look, background)
    });
    let views: Vec<_> = options
        .turns
        .par_iter()
        .enumerate()
        .map(|(index, &turn)| {
            let seed = options.seed ^ (index as u64 + 1).wrapping_mul(0x5851_f42d_4c95_7f2d);
            let mut random = Random::new(seed);
            let stance = &mut Random::new(!seed);
            let turned_more = options.turn_noise_radians * stance.normal();
            let mut pose = sway::sway(turned_more, options.sway, &mut random);
            let off_mm = sway::off_balance_mm(options.sway, stance);
            sway::stand(avatar, turn, off_mm, &mut pose);
            let PosedAvatar {
                bones: posed,
                positions,
            } = avatar.posed(&pose, turn);
            let coverage = render::silhouette(&positions, &avatar.mesh.triangles, &camera);
            let photo = match &painted {
                Some((look, background)) => {
                    let light = look.paint(background, &positions, &camera);
                    expose(
                        &light,
                        options.sensor_noise * lighting.noise_gain(),
                        &mut random,
                    )
                }
                None => Photo::filled(camera.width_px, camera.height_px, [0; 3]),
            };
            let scale = camera.focal_px() * stature_mm / camera.distance_mm / NOMINAL_STATURE_PX;
            let noise_px = options.keypoint_noise_px * scale;
            let keypoints = detect(avatar, &posed, &camera, noise_px, &mut random);
            let still = avatar.posed(&Pose::default(), turn).positions;
            let canonical =
                render::silhouette(&still, &avatar.mesh.triangles, &camera).threshold(0.5);
            let silhouette = coverage.threshold(0.5);
            let view = View {
                name: format!("{index:03}"),
                input_size_px: (camera.width_px, camera.height_px),
                photo,
                turn,
                turn_sd_radians: STATED_TURN_SD_DEGREES.to_radians(),
                time_s: None,
                keypoints,
                keypoints_from: KeypointSource::Given,
                keypoint_kind: KeypointKind::default(),
                mask: painted.is_none().then(|| silhouette.clone()),
                person_odds: None,
            };
            (view, pose, silhouette, canonical)
        })
        .collect();
    let mut truth = Truth {
        body: avatar.mesh.clone(),
        camera,
        poses: Vec::new(),
        silhouettes: Vec::new(),
        canonical: Vec::new(),
        room: painted.as_ref().map(|(_, room)| {
            let noise = options.sensor_noise * lighting.noise_gain();
            expose(room, noise, &mut Random::new(options.seed))
        }),
    };
    let mut scan = Scan {
        pose: avatar.pose,
        stature_mm: Some(stature_mm),
        stature_from: StatureFrom::Stated,
        mm_per_px: None,
        subject: Subject::default(),
        camera: CameraSetup {
            vertical_fov_radians: Some(camera.vertical_fov_radians),
            height_mm: Some(camera.height_mm),
            distance_mm: None,
            pitch_radians: (camera.pitch_radians != 0.0).then_some(camera.pitch_radians),
            yaw_radians: None,
            distortion: 0.0,
        },
        views: Vec::new(),
        background: None,
        unusable_view_count: 0,
        surface: None,
    };
    for (view, pose, silhouette, canonical) in views {
        scan.views.push(view);
        truth.poses.push(pose);
        truth.silhouettes.push(silhouette);
        truth.canonical.push(canonical);
    }
    SyntheticScan { scan, truth }
}

/// Simulates keypoints as reported by a detector: noisy, with lower confidence for hidden joints
///
/// The noise is the standard deviation of visible keypoints, in px of the photo.
fn detect(
    avatar: &Avatar,
    posed: &PosedBones,
    camera: &Camera,
    noise_px: f64,
    random: &mut Random,
) -> Keypoints {
    let visible = render::visible_bones(avatar, posed, camera);
    let mut points = PerJoint::splat(Keypoint::default());
    for joint in Joint::ALL {
        let place = posed.carry(joint.bone(), avatar.keypoints[joint]);
        let seen = visible[joint.bone()] && !faces_away(joint, posed);
        let sigma = noise_px * if seen { 1.0 } else { 3.0 };
        let confidence = if seen {
            random.between(0.72, 0.95)
        } else {
            random.between(0.35, 0.65)
        };
        points[joint] = Keypoint {
            position: camera.project(place) + DVec2::new(random.normal(), random.normal()) * sigma,
            confidence,
        };
    }
    points.set_middles(|left, right| Keypoint {
        position: (left.position + right.position) / 2.0,
        confidence: left.confidence.min(right.confidence),
    });
    Keypoints::new(points)
}

/// Returns whether a point of the face lies on the far side of the head
fn faces_away(joint: Joint, posed: &PosedBones) -> bool {
    let outward = match joint {
        Joint::Nose | Joint::LeftEye | Joint::RightEye => DVec3::Z,
        Joint::LeftEar => DVec3::X,
        Joint::RightEar => DVec3::NEG_X,
        _ => return false,
    };
    let head: DMat3 = posed.transforms[Bone::Head].matrix3;
    (head * outward).z < -0.1
}

/// Converts light to 8-bit pixels with sensor noise
fn expose(light: &Grid<[f32; 3]>, noise: f64, random: &mut Random) -> Photo {
    light.map(|c| {
        c.map(|v| {
            let level = 255.0 * f64::from(v).clamp(0.0, 1.0).powf(1.0 / 2.2);
            (level + noise * random.normal()).round().clamp(0.0, 255.0) as u8
        })
    })
}

/// Returns an avatar whose rest pose is rotated at the given bones, to vary arm and leg angles between people
pub fn with_posture(avatar: &Avatar, rotations: &[(Bone, DVec3)]) -> Avatar {
    let mut pose = Pose::default();
    for &(bone, rotation) in rotations {
        pose.rotations[bone] = rotation;
    }
    let moved = avatar.reposed(&pose);
    let low = moved.mesh.bounds().map_or(0.0, |(low, _)| low.y);
    moved.shifted(DVec3::new(0.0, -low, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    fn small_scan(sway: f64) -> (Avatar, SyntheticScan) {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let options = SyntheticOptions {
            seed: 5,
            turns: SyntheticOptions::even_turns(3),
            camera: SyntheticOptions::camera_for(avatar.stature_mm(), 120, 150),
            sway,
            keypoint_noise_px: 0.0,
            turn_noise_radians: 0.0,
            sensor_noise: 0.0,
            clutter: Clutter::LivedIn,
            photos: true,
        };
        let scan = synthesize(&avatar, &options);
        (avatar, scan)
    }

    #[test]
    fn without_sway_silhouettes_are_canonical_and_keypoints_exact() {
        let (avatar, synthetic) = small_scan(0.0);
        let truth = &synthetic.truth;
        for (silhouette, canonical) in truth.silhouettes.iter().zip(&truth.canonical) {
            assert!(silhouette.iou(canonical) > 0.999);
        }
        let wrist = synthetic.scan.views[0].keypoints.get(Joint::LeftWrist);
        let expected = truth.camera.project(avatar.keypoints[Joint::LeftWrist]);
        assert!((wrist.position - expected).length() < 0.5);
    }

    #[test]
    fn without_photos_the_exact_silhouettes_are_given() {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let options = SyntheticOptions {
            seed: 5,
            turns: SyntheticOptions::even_turns(3),
            camera: SyntheticOptions::camera_for(avatar.stature_mm(), 120, 150),
            sway: 0.0,
            keypoint_noise_px: 0.0,
            turn_noise_radians: 0.2,
            sensor_noise: 0.0,
            clutter: Clutter::Plain,
            photos: false,
        };
        let synthetic = synthesize(&avatar, &options);
        let views = synthetic.scan.views.iter();
        for (view, silhouette) in views.zip(&synthetic.truth.silhouettes) {
            assert_eq!(view.mask.as_ref(), Some(silhouette));
        }
        let turned: Vec<f64> = synthetic
            .truth
            .poses
            .iter()
            .map(|pose| pose.rotations[Bone::Root].y)
            .collect();
        assert!(turned.iter().any(|angle| angle.abs() > 0.02), "{turned:?}");
    }

    #[test]
    fn the_room_is_static_while_the_person_turns_and_sways() {
        let (_, synthetic) = small_scan(1.0);
        let [a, b] = [
            &synthetic.scan.views[0].photo,
            &synthetic.scan.views[2].photo,
        ];
        for y in 0..40 {
            for x in 0..20 {
                assert_eq!(a[(x, y)], b[(x, y)], "the wall at ({x}, {y})");
            }
        }
        let [a, b] = [
            &synthetic.truth.silhouettes[0],
            &synthetic.truth.silhouettes[2],
        ];
        assert!(a.iou(b) < 0.95);
        // the soles are on the floor
        let bottom = a.bounding_box().unwrap().3;
        let still = synthetic.truth.canonical[0].bounding_box().unwrap().3;
        assert!(bottom.abs_diff(still) <= 2);
    }
}

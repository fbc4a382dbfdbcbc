use proptest::prelude::*;
mod hull;

use serde_json::{Value, json};

use super::*;
use crate::Joint;

/// Variations of the test bodies
#[derive(Clone)]
struct TestBody {
    /// Node name of each bone; the upper spine's and clavicles' may be missing
    name: fn(Bone) -> Option<String>,
    extensions: Value,
    faces_back: bool,
    /// Degrees below the horizontal
    arm_angle: f64,
    /// Nose and ears: corners of boxes, so that each has one foremost or outermost point
    face: bool,
    /// A small loose box in front of the head
    loose_part: bool,
    /// One box around everything, so that one part is the complete body
    wrapped: bool,
    /// A bone that the rig has, but the surface does not
    absent: Option<Bone>,
    /// Number of triangles that are missing at the end of the last part
    hole: usize,
}

impl Default for TestBody {
    fn default() -> Self {
        Self {
            name: mixamo,
            extensions: Value::Null,
            faces_back: false,
            arm_angle: 0.0,
            face: false,
            loose_part: false,
            wrapped: false,
            absent: None,
            hole: 0,
        }
    }
}

fn mixamo(bone: Bone) -> Option<String> {
    use Bone::*;
    let name = match bone {
        Root => "Hips",
        LowerSpine => "Spine",
        UpperSpine => "Spine1",
        Neck => "Neck",
        Head => "Head",
        LeftClavicle => "LeftShoulder",
        LeftUpperArm => "LeftArm",
        LeftForearm => "LeftForeArm",
        LeftHand => "LeftHand",
        LeftThigh => "LeftUpLeg",
        LeftShin => "LeftLeg",
        LeftFoot => "LeftFoot",
        other => return mixamo(other.mirrored()).map(|name| name.replace("Left", "Right")),
    };
    Some(format!(
        "mixamorig:{}",
        name.trim_start_matches("mixamorig:")
    ))
}

/// Joint positions of the test body, in meters
fn joint(bone: Bone, arm_angle: f64) -> DVec3 {
    use Bone::*;
    let along_arm = |distance: f64| {
        let (sin, cos) = arm_angle.to_radians().sin_cos();
        DVec3::new(0.18 + distance * cos, 1.4 - distance * sin, 0.0)
    };
    match bone {
        Root => DVec3::new(0.0, 0.95, 0.0),
        LowerSpine => DVec3::new(0.0, 1.0, 0.0),
        UpperSpine => DVec3::new(0.0, 1.2, 0.0),
        Neck => DVec3::new(0.0, 1.45, 0.0),
        Head => DVec3::new(0.0, 1.55, 0.0),
        LeftClavicle => DVec3::new(0.03, 1.4, 0.0),
        LeftUpperArm => along_arm(0.0),
        LeftForearm => along_arm(0.28),
        LeftHand => along_arm(0.53),
        LeftThigh => DVec3::new(0.1, 0.9, 0.0),
        LeftShin => DVec3::new(0.1, 0.5, 0.0),
        LeftFoot => DVec3::new(0.1, 0.08, 0.0),
        right => joint(right.mirrored(), arm_angle) * DVec3::new(-1.0, 1.0, 1.0),
    }
}

/// Opposite corners of a bone's box in meters, the arms' along x from the joint before they are rotated down
fn bone_box(bone: Bone) -> (DVec3, DVec3) {
    use Bone::*;
    let v = DVec3::new;
    match bone {
        Root => (v(-0.16, 0.85, -0.1), v(0.16, 1.0, 0.1)),
        LowerSpine => (v(-0.15, 1.0, -0.1), v(0.15, 1.2, 0.1)),
        UpperSpine => (v(-0.17, 1.2, -0.1), v(0.17, 1.42, 0.1)),
        Neck => (v(-0.05, 1.42, -0.05), v(0.05, 1.52, 0.05)),
        Head => (v(-0.08, 1.52, -0.1), v(0.08, 1.75, 0.1)),
        LeftClavicle => (v(0.03, 1.36, -0.05), v(0.19, 1.45, 0.05)),
        LeftUpperArm => (v(0.17, 1.36, -0.04), v(0.46, 1.44, 0.04)),
        LeftForearm => (v(0.45, 1.37, -0.03), v(0.71, 1.43, 0.03)),
        LeftHand => (v(0.7, 1.38, -0.03), v(0.88, 1.42, 0.05)),
        LeftThigh => (v(0.03, 0.5, -0.08), v(0.17, 0.88, 0.08)),
        LeftShin => (v(0.05, 0.08, -0.06), v(0.15, 0.5, 0.06)),
        LeftFoot => (v(0.05, 0.0, -0.08), v(0.15, 0.08, 0.18)),
        right => {
            let (low, high) = bone_box(right.mirrored());
            (v(-high.x, low.y, low.z), v(-low.x, high.y, high.z))
        }
    }
}

/// A body of boxes with four vertices per side, as exporters write them, as GLB
fn glb(body: &TestBody) -> Vec<u8> {
    let turned = |p: DVec3| {
        if body.faces_back {
            DVec3::new(-p.x, p.y, -p.z)
        } else {
            p
        }
    };
    let bones: Vec<Bone> = Bone::ALL
        .into_iter()
        .filter(|&bone| (body.name)(bone).is_some())
        .collect();
    let kept = |mut bone: Bone| loop {
        match bones.iter().position(|&b| b == bone) {
            Some(index) => return Some(index),
            None => bone = bone.parent()?,
        }
    };
    let world = |index: usize| turned(joint(bones[index], body.arm_angle));

    let mut nodes: Vec<Value> = Vec::new();
    for (index, &bone) in bones.iter().enumerate() {
        let parent = bone.parent().and_then(kept);
        let offset = world(index) - parent.map_or(DVec3::ZERO, world);
        let children: Vec<usize> = (0..bones.len())
            .filter(|&c| bones[c].parent().and_then(kept) == Some(index))
            .collect();
        let name = (body.name)(bone).unwrap_or_default();
        nodes.push(json!({"name": name, "translation": offset.to_array(), "children": children}));
    }
    nodes.push(json!({"mesh": 0, "skin": 0}));

    let (mut positions, mut joints, mut indices) = (Vec::new(), Vec::new(), Vec::new());
    let mut add_box = |low: DVec3, high: DVec3, joint: usize, place: &dyn Fn(DVec3) -> DVec3| {
        for axis in 0..3 {
            for far in [false, true] {
                let first = positions.len() as u32;
                for (u, v) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
                    let mut share = [0.0; 3];
                    share[axis] = f64::from(u8::from(far));
                    share[(axis + 1) % 3] = u;
                    share[(axis + 2) % 3] = v;
                    let p = low + (high - low) * DVec3::from_array(share);
                    positions.push(place(p));
                    joints.push(joint as u16);
                }
                let quad = if far {
                    [0, 1, 2, 0, 2, 3]
                } else {
                    [0, 2, 1, 0, 3, 2]
                };
                indices.extend(quad.map(|i| first + i));
            }
        }
    };
    for bone in Bone::ALL
        .into_iter()
        .filter(|&bone| Some(bone) != body.absent)
    {
        let (low, high) = bone_box(bone);
        let is_arm =
            bone.descends_from(Bone::LeftUpperArm) || bone.descends_from(Bone::RightUpperArm);
        let side = if bone.descends_from(Bone::RightUpperArm) {
            -1.0
        } else {
            1.0
        };
        let pivot = joint(Bone::LeftUpperArm, 0.0) * DVec3::new(side, 1.0, 1.0);
        let turn = DQuat::from_rotation_z(-side * body.arm_angle.to_radians());
        let place = |p: DVec3| {
            turned(if is_arm {
                pivot + turn * (p - pivot)
            } else {
                p
            })
        };
        add_box(low, high, kept(bone).unwrap_or(0), &place);
    }
    if body.face {
        // Smaller boxes would be dropped as scraps.
        let (half, protrusion) = (0.04, 0.03);
        for (on_head, outward) in [
            (DVec3::new(0.0, 1.62, 0.1), DVec3::Z),
            (DVec3::new(0.08, 1.65, 0.0), DVec3::X),
            (DVec3::new(-0.08, 1.65, 0.0), -DVec3::X),
        ] {
            let corner = DVec3::splat(half);
            let turn = DQuat::from_rotation_arc(corner / corner.length(), outward);
            let center = on_head + outward * (protrusion - corner.length());
            let place = |p: DVec3| turned(center + turn * p);
            add_box(-corner, corner, kept(Bone::Head).unwrap_or(0), &place);
        }
    }
    if body.loose_part {
        let low = DVec3::new(0.02, 1.62, 0.12);
        add_box(low, low + 0.02, kept(Bone::Head).unwrap_or(0), &turned);
    }
    if body.wrapped {
        let (low, high) = (DVec3::new(-0.9, 0.0, -0.3), DVec3::new(0.9, 1.8, 0.3));
        add_box(low, high, 0, &turned);
    }

    indices.truncate(indices.len() - 3 * body.hole);
    let mut binary: Vec<u8> = Vec::new();
    let mut views: Vec<Value> = Vec::new();
    let mut view = |bytes: Vec<u8>| {
        views.push(json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len()}));
        binary.extend(bytes);
        binary.resize(binary.len().next_multiple_of(4), 0);
    };
    let floats = |values: &[f64]| -> Vec<u8> {
        values
            .iter()
            .flat_map(|&v| (v as f32).to_le_bytes())
            .collect()
    };
    let count = positions.len();
    view(
        positions
            .iter()
            .flat_map(|p| floats(&p.to_array()))
            .collect(),
    );
    view(
        joints
            .iter()
            .flat_map(|&j| [j, 0, 0, 0])
            .flat_map(u16::to_le_bytes)
            .collect(),
    );
    view(floats(&[1.0, 0.0, 0.0, 0.0].repeat(count)));
    view(indices.iter().flat_map(|i| i.to_le_bytes()).collect());
    let inverse_binds = (0..bones.len())
        .flat_map(|index| floats(&DMat4::from_translation(-world(index)).to_cols_array()))
        .collect();
    view(inverse_binds);
    let accessor = |view: usize, code: u32, count: usize, shape: &str| json!({"bufferView": view, "componentType": code, "count": count, "type": shape});
    let document = json!({
        "asset": {"version": "2.0"},
        "nodes": nodes,
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}, "indices": 3}]}],
        "skins": [{"joints": (0..bones.len()).collect::<Vec<_>>(), "inverseBindMatrices": 4}],
        "accessors": [accessor(0, 5126, count, "VEC3"), accessor(1, 5123, count, "VEC4"),
            accessor(2, 5126, count, "VEC4"), accessor(3, 5125, indices.len(), "SCALAR"),
            accessor(4, 5126, bones.len(), "MAT4")],
        "bufferViews": views,
        "buffers": [{"byteLength": binary.len()}],
        "extensions": body.extensions,
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    let total = 12 + 8 + text.len() + 8 + binary.len();
    file.extend([2, total as u32].iter().flat_map(|v| v.to_le_bytes()));
    file.extend((text.len() as u32).to_le_bytes());
    file.extend(b"JSON");
    file.extend(text);
    file.extend((binary.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(binary);
    file
}

fn load(body: &TestBody, pose: ReferencePose) -> Avatar {
    let avatar = load_avatar(&glb(body), pose).expect("a loadable file");
    avatar.check().expect("a valid avatar");
    avatar
}

fn direction(avatar: &Avatar, from: Bone, to: Bone) -> DVec3 {
    let d = avatar.bone_heads[to] - avatar.bone_heads[from];
    d / d.length()
}

#[test]
fn joints_are_at_the_positions_of_the_file() {
    let avatar = load(&TestBody::default(), ReferencePose::T);
    assert!((avatar.stature_mm() - 1750.0).abs() < 0.1);
    for bone in [
        Bone::Root,
        Bone::UpperSpine,
        Bone::LeftShin,
        Bone::RightFoot,
    ] {
        let shift = DVec3::Z * TURNING_AXIS_BEHIND_HIPS * 1750.0;
        let expected = joint(bone, 0.0) * 1000.0 + shift;
        let found = avatar.bone_heads[bone];
        assert!((found - expected).length() < 0.1, "{bone:?} {found}");
    }
    let nose = avatar.keypoints[Joint::Nose];
    let ear = avatar.keypoints[Joint::LeftEar];
    assert!(nose.z > 90.0 && nose.x.abs() < 10.0 && ear.x > 70.0);
    let toe = avatar.keypoints[Joint::LeftBigToe];
    let heel = avatar.keypoints[Joint::LeftHeel];
    assert!(toe.z > 100.0 && heel.z < -60.0 && toe.y < 40.0);
}

#[test]
fn boxes_become_one_closed_surface() {
    let avatar = load(&TestBody::default(), ReferencePose::T);
    assert_eq!(avatar.mesh.check(), Ok(()));
    assert_eq!(avatar.mesh.components().len(), 1);
    for (p, w) in avatar.mesh.positions.iter().zip(&avatar.weights) {
        if p.y > 1530.0 {
            assert_eq!(w.strongest(), Bone::Head);
        }
    }
}

#[test]
fn arms_are_lowered_and_lifted_to_the_pose() {
    let (a, t) = (ReferencePose::A, ReferencePose::T);
    for (rest_angle, pose) in [(0.0, a), (30.0, t), (70.0, a)] {
        let body = TestBody {
            arm_angle: rest_angle,
            ..TestBody::default()
        };
        let avatar = load(&body, pose);
        let arm = direction(&avatar, Bone::LeftUpperArm, Bone::LeftForearm);
        let angle = (-arm.y).atan2(arm.x).to_degrees();
        assert!((angle - pose.arm_angle_degrees()).abs() < 1e-6, "{angle}");
        let forearm = direction(&avatar, Bone::RightForearm, Bone::RightHand);
        let bend = forearm.z.asin().to_degrees();
        assert!((bend - pose.elbow_bend_degrees()).abs() < 1e-6, "{bend}");
    }
}

#[test]
fn arms_near_the_pose_are_unchanged() {
    let body = TestBody {
        arm_angle: 5.0,
        ..TestBody::default()
    };
    let avatar = load(&body, ReferencePose::T);
    let arm = direction(&avatar, Bone::LeftUpperArm, Bone::LeftForearm);
    assert!(((-arm.y).asin().to_degrees() - 5.0).abs() < 1e-4);
}

#[test]
fn a_body_that_faces_backward_is_turned_around() {
    let [turned, straight] = [true, false].map(|faces_back| {
        let body = TestBody {
            faces_back,
            face: true,
            ..TestBody::default()
        };
        load(&body, ReferencePose::A)
    });
    for (a, b) in turned.bone_heads.iter().zip(&straight.bone_heads) {
        assert!((*a - *b).length() < 0.1);
    }
    // Hulls of surfaces that differ by rounding have the same points within a cell.
    for (joint, b) in straight.keypoints.pairs() {
        let a = turned.keypoints[joint];
        assert!(a.distance(*b) < 10.0, "{}: {a} {b}", joint.name());
    }
    let nose = turned.keypoints[Joint::Nose];
    assert!((nose.y - 1620.0).abs() < 10.0, "{nose}");
    let ear = turned.keypoints[Joint::LeftEar];
    assert!((ear.x - 110.0).abs() < 10.0, "{ear}");
}

fn nameless(bone: Bone) -> Option<String> {
    Some(format!("node_{}", bone as usize))
}

#[test]
fn humanoid_tables_of_both_vrm_versions_name_the_bones() {
    let bones = Bone::ALL.map(|bone| (rig::vrm_name(bone), bone as usize));
    let list: Vec<Value> = bones
        .iter()
        .filter_map(|(name, node)| Some(json!({"bone": (*name)?, "node": node})))
        .collect();
    let map: serde_json::Map<String, Value> = bones
        .iter()
        .filter_map(|(name, node)| Some(((*name)?.to_owned(), json!({"node": node}))))
        .collect();
    let old = json!({"VRM": {"humanoid": {"humanBones": list}}});
    let new = json!({"VRMC_vrm": {"humanoid": {"humanBones": map}}});
    let named = load(&TestBody::default(), ReferencePose::A);
    for extensions in [old, new] {
        let body = TestBody {
            name: nameless,
            extensions,
            ..TestBody::default()
        };
        assert_eq!(load(&body, ReferencePose::A).bone_heads, named.bone_heads);
    }
}

fn no_extras(bone: Bone) -> Option<String> {
    let optional = matches!(
        bone,
        Bone::UpperSpine | Bone::Neck | Bone::LeftClavicle | Bone::RightClavicle
    );
    if optional { None } else { mixamo(bone) }
}

#[test]
fn missing_clavicles_neck_and_upper_spine_are_inferred() {
    let body = TestBody {
        name: no_extras,
        ..TestBody::default()
    };
    let avatar = load(&body, ReferencePose::A);
    let y = |bone: Bone| avatar.bone_heads[bone].y;
    assert!(y(Bone::LowerSpine) < y(Bone::UpperSpine) && y(Bone::UpperSpine) < y(Bone::Neck));
    assert!(y(Bone::Neck) < y(Bone::Head));
    let clavicle = avatar.bone_heads[Bone::LeftClavicle];
    assert!(clavicle.x > 0.0 && clavicle.x < avatar.bone_heads[Bone::LeftUpperArm].x);
    let chest = avatar
        .weights
        .iter()
        .any(|w| w.strongest() == Bone::UpperSpine);
    assert!(chest, "the trunk is split");
}

fn no_left_elbow(bone: Bone) -> Option<String> {
    if bone == Bone::LeftForearm {
        None
    } else {
        mixamo(bone)
    }
}

#[test]
fn the_error_names_the_missing_joints() {
    let body = TestBody {
        name: no_left_elbow,
        ..TestBody::default()
    };
    let error = load_avatar(&glb(&body), ReferencePose::A).unwrap_err();
    assert_eq!(
        error.to_string(),
        "joints not found in the rig: left_forearm"
    );
    let body = TestBody {
        name: nameless,
        ..TestBody::default()
    };
    let error = load_avatar(&glb(&body), ReferencePose::A).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("rig: root, head, left_upper_arm"),
        "{error}"
    );
}

/// A box as eight vertices and twelve triangles
fn add_box(surface: &mut Surface, low: DVec3, high: DVec3) {
    let first = surface.positions.len() as u32;
    for i in 0..8 {
        let far = DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
        surface.positions.push(low + (high - low) * far);
        surface.weights.push(PerBone::splat(0.0));
    }
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    for [a, b, c, d] in quads {
        for triangle in [[a, b, c], [a, c, d]] {
            surface.triangles.push(triangle.map(|v| first + v));
        }
    }
}

#[test]
fn loose_parts_are_dropped_when_one_part_is_the_complete_body() {
    let mut surface = Surface::default();
    add_box(&mut surface, DVec3::ZERO, DVec3::new(0.4, 1.8, 0.3));
    add_box(&mut surface, DVec3::ONE, DVec3::splat(1.02));
    surface.keep_the_body();
    assert_eq!(surface.triangles.len(), 12, "only the body");
    let mut surface = Surface::default();
    add_box(&mut surface, DVec3::ZERO, DVec3::new(0.4, 0.9, 0.3));
    add_box(&mut surface, DVec3::Y * 0.9, DVec3::new(0.4, 1.8, 0.3));
    add_box(&mut surface, DVec3::ONE, DVec3::splat(1.02));
    surface.keep_the_body();
    assert_eq!(surface.triangles.len(), 24, "a scrap less");
}

#[test]
fn scaling_keeps_the_shape() {
    let avatar = load(&TestBody::default(), ReferencePose::A);
    // The hull of the boxes is not exactly as high as they are.
    assert!((avatar.stature_mm() - 1750.0).abs() < 0.1);
    let factor = 3500.0 / avatar.stature_mm();
    let twice = avatar.clone().scaled_to(3500.0);
    assert!((twice.stature_mm() - 3500.0).abs() < 1e-6);
    for (scaled, head) in twice.bone_heads.iter().zip(&avatar.bone_heads) {
        assert!((*scaled - *head * factor).length() < 1e-9);
    }
    twice.check().unwrap();
}

#[test]
fn unusable_files_are_rejected_with_the_reason() {
    let error = |bytes: &[u8]| {
        load_avatar(bytes, ReferencePose::A)
            .unwrap_err()
            .to_string()
    };
    assert_eq!(error(b""), "not a glTF file");
    assert_eq!(error(b"{}"), "the file contains no mesh with a skin");
    assert_eq!(error(b"glTF\x02\0\0\0"), "the GLB file is truncated");
    assert!(error(b"glTF\x01\0\0\0\0\0\0\0").contains("version 1"));
    let file = glb(&TestBody::default());
    assert_eq!(error(&file[..file.len() / 2]), "the GLB file is truncated");
    let draco = br#"{"extensionsRequired":["KHR_draco_mesh_compression"]}"#;
    assert!(error(draco).contains("KHR_draco_mesh_compression"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    #[test]
    fn mutated_files_load_or_fail_but_never_panic(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        cut in any::<prop::sample::Index>(),
        in_text in any::<bool>(),
    ) {
        let mut bytes = glb(&TestBody::default());
        let text_end = 20 + u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        for (index, value) in &changes {
            // digits keep the JSON valid and break the numbers in it
            if in_text {
                let digits: Vec<usize> =
                    (20..text_end).filter(|&i| bytes[i].is_ascii_digit()).collect();
                bytes[digits[index.index(digits.len())]] = b'0' + value % 10;
            } else {
                let at = index.index(bytes.len());
                bytes[at] = *value;
            }
        }
        if changes.len() == 3 {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(avatar) = load_avatar(&bytes, ReferencePose::A) {
            prop_assert!(avatar.check().is_ok());
        }
    }
}

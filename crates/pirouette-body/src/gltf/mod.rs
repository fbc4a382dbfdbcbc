//! Skinned glTF 2.0 and VRM humanoids as avatars.
//!
//! Accepts any rig whose nodes can be identified: by the humanoid table of VRM 0.x or 1.0, or by the names that
//! MakeHuman, Mixamo, Unreal, Biped and Rigify use. Its joints, regardless of their number, are assigned to our 19
//! bones: each follows its nearest ancestor that is one of them. The body is loaded in the pose of its rig, turned to
//! face +z, put on the floor and moved into the requested pose.
//!
//! A surface of several shells, or with holes, is replaced by its outer hull. Figures without arms or legs, or with the
//! proportions of cartoons, are rejected.
//!
//! Not read: animations, morph targets, materials, meshes without a skin, compressed geometry, and buffers in other
//! files.

mod closed;
mod document;
mod rig;
mod surface;

use glam::{DAffine3, DMat4, DQuat, DVec3};

use crate::{
    Avatar, Bone, PerBone, PerJoint, ReferencePose, SkinWeight, TURNING_AXIS_BEHIND_HIPS,
    detector_points, stance,
};
use document::{Document, Node};
use rig::{Rig, ancestors, is_optional, parents};
use surface::Surface;

pub use closed::HullUsed;
pub use document::AccessorDefect;

/// Millimeters in the unit of glTF
const MM_PER_METER: f64 = 1000.0;

/// Position of the upper spine's joint, as a share of the way from the hips up to the neck
///
/// The lower end of the rib cage. Rigs have two to five spine joints; the one nearest to it is used.
const UPPER_SPINE_SHARE: f64 = 0.41;

/// Position of the clavicle's joint, as a share of the way from the middle to the shoulder
const CLAVICLE_SHARE: f64 = 0.13;

/// Half the height, in mm, over which the trunk blends from the lower spine to an upper spine that the rig lacks
const SPINE_BLEND_MM: f64 = 80.0;

/// Why a file cannot be used as an avatar
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadAvatarError {
    /// Neither GLB nor JSON, or JSON that is not glTF
    #[error("not a glTF file")]
    Json(#[source] serde_json::Error),
    /// The file is truncated
    #[error("the GLB file is truncated")]
    Truncated,
    /// Another version of the format
    #[error("glTF version {version} is not supported, only version 2")]
    #[allow(missing_docs, reason = "the message documents the variant")]
    Version { version: u32 },
    /// Geometry that needs a decoder
    #[error("the geometry is compressed with {extension}; export the avatar without compression")]
    #[allow(missing_docs, reason = "the message documents the variant")]
    Compressed { extension: &'static str },
    /// Geometry in another file
    #[error("buffer {buffer} lies in another file; export the avatar as one GLB file")]
    #[allow(missing_docs, reason = "the message documents the variant")]
    ExternalBuffer { buffer: usize },
    /// An accessor that cannot be read
    #[error("accessor {accessor} is broken: {defect}")]
    #[allow(missing_docs, reason = "the message documents the variant")]
    Accessor {
        accessor: usize,
        #[source]
        defect: AccessorDefect,
    },
    /// An index that refers to no element
    #[error("mesh {mesh} names a vertex, joint or skin that does not exist")]
    #[allow(missing_docs, reason = "the message documents the variant")]
    Index { mesh: usize },
    /// No mesh with a skin
    #[error("the file contains no mesh with a skin")]
    NoSkin,
    /// Required joints without a node in the rig
    #[error("joints not found in the rig: {}", names(missing))]
    #[allow(missing_docs, reason = "the message documents the variant")]
    MissingJoints { missing: Vec<Bone> },
    /// Parts that are too far from each other for a common hull
    #[error(
        "the surface has {part_count} parts that do not connect to one body; export it as one closed mesh"
    )]
    #[allow(missing_docs, reason = "the message documents the variant")]
    NoHull { part_count: usize },
    /// A rig with bones that the surface does not have
    #[error("the surface has no {}: the middle of this bone is not inside a limb; export the complete body", bone.name())]
    #[allow(missing_docs, reason = "the message documents the variant")]
    MissingLimb { bone: Bone },
    /// A figure that is not built like a person
    #[error(
        "{part}: {percent:.0} % of the height; between {lowest_percent:.0} and {highest_percent:.0} % for people: use an avatar with human proportions"
    )]
    #[allow(missing_docs, reason = "the message documents the variant")]
    Proportions {
        part: &'static str,
        percent: f64,
        lowest_percent: f64,
        highest_percent: f64,
    },
    /// No extent, or coordinates that are not finite
    #[error("the body is flat, empty or not finite")]
    Degenerate,
}

/// Loads all meshes of a file as one surface, in the frame and the unit of the file
///
/// Skinned meshes are in the pose of their rig. Vertices along seams are merged, and all parts are kept.
///
/// # Errors
/// When the bytes are not readable glTF.
pub fn load_surface(bytes: &[u8]) -> Result<pirouette_geom::TriMesh, LoadAvatarError> {
    let document = Document::parse(bytes)?;
    let nodes = &document.root.nodes;
    let world_from_node = world_transforms(nodes, &parents(nodes));
    let no_bones = vec![Bone::Root; nodes.len()];
    let mut surface = Surface::default();
    for (node, world) in nodes.iter().zip(&world_from_node) {
        match (node.mesh, node.skin) {
            (Some(mesh), Some(skin)) => {
                surface.add_skinned_mesh(&document, mesh, skin, &world_from_node, &no_bones)?;
            }
            (Some(mesh), None) => surface.add_rigid_mesh(&document, mesh, *world)?,
            (None, _) => {}
        }
    }
    surface.weld();
    surface.compact();
    Ok(surface.mesh())
}

fn names(bones: &[Bone]) -> String {
    let names: Vec<&str> = bones.iter().map(|bone| bone.name()).collect();
    names.join(", ")
}

/// Loads a skinned humanoid and moves it into a reference pose
///
/// The result is one closed surface, stands on the floor, faces +z and has the size given in the file; see
/// [`Avatar::scaled_to`]. Loose parts such as eyes and teeth are dropped if one part is the complete body; a surface of
/// several parts, or with holes, is replaced by its outer hull.
///
/// # Errors
/// When the bytes are not readable glTF, have no skin, lack a joint that cannot be inferred from the others (clavicles,
/// neck and upper spine can), the body has no extent, lacks an arm or a leg, or does not have human proportions.
pub fn load_avatar(bytes: &[u8], pose: ReferencePose) -> Result<Avatar, LoadAvatarError> {
    load_avatar_with_hull(bytes, pose).map(|(avatar, _)| avatar)
}

/// Like [`load_avatar`]; also returns whether the surface was replaced by its hull
///
/// # Errors
/// Those of [`load_avatar`].
pub fn load_avatar_with_hull(
    bytes: &[u8],
    pose: ReferencePose,
) -> Result<(Avatar, Option<HullUsed>), LoadAvatarError> {
    let document = Document::parse(bytes)?;
    let nodes = &document.root.nodes;
    let parents = parents(nodes);
    let world_from_node = world_transforms(nodes, &parents);
    let skinned: Vec<(usize, usize)> = nodes
        .iter()
        .filter_map(|node| Some((node.mesh?, node.skin?)))
        .collect();
    if skinned.is_empty() {
        return Err(LoadAvatarError::NoSkin);
    }

    let mut bones = find_bones(&document, &parents, &skinned, &world_from_node)?;
    let bone_of_node: Vec<Bone> = (0..nodes.len())
        .map(|n| {
            ancestors(&parents, n)
                .find_map(|a| {
                    let mut found = bones.nodes.pairs();
                    found.find_map(|(bone, &node)| (node == Some(a)).then_some(bone))
                })
                .unwrap_or(Bone::Root)
        })
        .collect();
    let mut surface = Surface::default();
    for &(mesh, skin) in &skinned {
        surface.add_skinned_mesh(&document, mesh, skin, &world_from_node, &bone_of_node)?;
    }
    surface.weld();
    surface.keep_the_body();

    let ours_from_file = upright_and_facing(&bones.heads)?;
    let place = |p: &mut DVec3| *p = ours_from_file.transform_point3(*p);
    surface.positions.iter_mut().for_each(place);
    bones.heads.iter_mut().for_each(place);
    bones.eyes.iter_mut().flatten().for_each(place);
    surface.face_outward();
    let hull = closed::close(&mut surface)?;
    if bones.nodes[Bone::UpperSpine].is_none() {
        split_the_trunk(&mut surface, bones.heads[Bone::UpperSpine].y);
    }

    let (mesh, weights) = surface.into_mesh();
    let (low, high) = mesh.bounds().ok_or(LoadAvatarError::Degenerate)?;
    let heads_are_finite = bones.heads.iter().all(|head| head.is_finite());
    if !(low.is_finite() && high.is_finite() && heads_are_finite && high.y - low.y > 0.0) {
        return Err(LoadAvatarError::Degenerate);
    }
    let mut avatar = Avatar {
        mesh,
        weights,
        bone_heads: bones.heads,
        keypoints: PerJoint::splat(DVec3::ZERO),
        pose,
    };
    put_on_the_axis(&mut avatar, &mut bones.eyes);
    closed::check_person(&avatar)?;
    stance::pose_arms(&mut avatar, pose);
    avatar.keypoints = detector_points::find_keypoints(
        &avatar.mesh,
        &avatar.weights,
        &avatar.bone_heads,
        bones.eyes,
    );
    Ok((avatar, hull))
}

/// Returns the world matrix of every node
fn world_transforms(nodes: &[Node], parents: &[Option<usize>]) -> Vec<DMat4> {
    let local = |node: &Node| match node.matrix {
        Some(matrix) => DMat4::from_cols_array(&matrix),
        None => DMat4::from_scale_rotation_translation(
            DVec3::from_array(node.scale.unwrap_or([1.0; 3])),
            node.rotation
                .map_or(DQuat::IDENTITY, |q| unit_quaternion(DQuat::from_array(q))),
            DVec3::from_array(node.translation.unwrap_or([0.0; 3])),
        ),
    };
    (0..nodes.len())
        .map(|n| ancestors(parents, n).fold(DMat4::IDENTITY, |below, a| local(&nodes[a]) * below))
        .collect()
}

fn unit_quaternion(q: DQuat) -> DQuat {
    let length = q.length();
    if length > 0.0 && length.is_finite() {
        q / length
    } else {
        DQuat::IDENTITY
    }
}

/// The nodes of our bones and their joint positions, in the file's world frame
struct FoundBones {
    nodes: PerBone<Option<usize>>,
    heads: PerBone<DVec3>,
    eyes: [Option<DVec3>; 2],
}

fn find_bones(
    document: &Document,
    parents: &[Option<usize>],
    skinned: &[(usize, usize)],
    world_from_node: &[DMat4],
) -> Result<FoundBones, LoadAvatarError> {
    let candidates: std::collections::BTreeSet<usize> = skinned
        .iter()
        .filter_map(|&(_, skin)| document.root.skins.get(skin))
        .flat_map(|skin| &skin.joints)
        .filter(|&&joint| joint < parents.len())
        .flat_map(|&joint| ancestors(parents, joint))
        .collect();
    let candidates: Vec<usize> = candidates.into_iter().collect();
    let Rig {
        bones: mut nodes,
        eyes,
    } = Rig::find(document, &candidates);
    let at = |node: usize| world_from_node[node].w_axis.truncate();

    // The spine is the chain between hips and neck, regardless of its names.
    let hips = nodes[Bone::Root];
    let top = nodes[Bone::Neck].or(nodes[Bone::Head]);
    if let (Some(hips), Some(top)) = (hips, top) {
        let mut spine: Vec<usize> = ancestors(parents, top)
            .skip(1)
            .take_while(|&n| n != hips)
            .collect();
        spine.reverse();
        nodes[Bone::LowerSpine] = spine.first().copied();
        let turn = at(hips).lerp(at(top), UPPER_SPINE_SHARE);
        let distance = |n: &usize| (at(*n) - turn).length();
        nodes[Bone::UpperSpine] = spine
            .iter()
            .skip(1)
            .copied()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
    }
    let between = |bone: Bone| bone == Bone::LowerSpine && (hips.is_none() || top.is_none());
    let missing: Vec<Bone> = Bone::ALL
        .into_iter()
        .filter(|&bone| nodes[bone].is_none() && !is_optional(bone) && !between(bone))
        .collect();
    if !missing.is_empty() {
        return Err(LoadAvatarError::MissingJoints { missing });
    }

    let mut heads = nodes.map(|node| node.map_or(DVec3::ZERO, at));
    let mid_shoulders = (heads[Bone::LeftUpperArm] + heads[Bone::RightUpperArm]) / 2.0;
    for bone in Bone::ALL {
        if nodes[bone].is_some() {
            continue;
        }
        let (root, head) = (heads[Bone::Root], heads[Bone::Head]);
        heads[bone] = match bone {
            Bone::UpperSpine => root.lerp(mid_shoulders, UPPER_SPINE_SHARE),
            Bone::Neck => mid_shoulders.lerp(head, 0.4),
            Bone::LeftClavicle => mid_shoulders.lerp(heads[Bone::LeftUpperArm], CLAVICLE_SHARE),
            _ => mid_shoulders.lerp(heads[Bone::RightUpperArm], CLAVICLE_SHARE),
        };
    }
    Ok(FoundBones {
        nodes,
        heads,
        eyes: eyes.map(|eye| eye.map(at)),
    })
}

/// Returns the transform to millimeters that turns the body about the vertical so that the left hip and shoulder lie
/// towards +x
fn upright_and_facing(heads: &PerBone<DVec3>) -> Result<DAffine3, LoadAvatarError> {
    let across = |left: Bone, right: Bone| heads[left] - heads[right];
    let left =
        across(Bone::LeftThigh, Bone::RightThigh) + across(Bone::LeftUpperArm, Bone::RightUpperArm);
    if !(left.is_finite() && left.x.hypot(left.z) > 0.0) {
        return Err(LoadAvatarError::Degenerate);
    }
    let yaw = left.z.atan2(left.x);
    let turn = DQuat::from_rotation_y(yaw);
    Ok(DAffine3::from_scale_rotation_translation(
        DVec3::splat(MM_PER_METER),
        turn,
        DVec3::ZERO,
    ))
}

/// Attaches the trunk above the upper spine's head to it, for rigs with a single spine joint
fn split_the_trunk(surface: &mut Surface, height_mm: f64) {
    for (p, weight) in surface.positions.iter().zip(&mut surface.weights) {
        let t = ((p.y - height_mm) / (2.0 * SPINE_BLEND_MM) + 0.5).clamp(0.0, 1.0);
        let moved = weight[Bone::LowerSpine] * t * t * (3.0 - 2.0 * t);
        weight[Bone::LowerSpine] -= moved;
        weight[Bone::UpperSpine] += moved;
    }
}

/// Puts the soles on the floor and the turning axis slightly behind the midpoint of the hip joints
fn put_on_the_axis(avatar: &mut Avatar, eyes: &mut [Option<DVec3>; 2]) {
    let Some((low, high)) = avatar.mesh.bounds() else {
        return;
    };
    let heads = &avatar.bone_heads;
    let hips = (heads[Bone::LeftThigh] + heads[Bone::RightThigh]) / 2.0;
    let axis_z = hips.z - TURNING_AXIS_BEHIND_HIPS * (high.y - low.y);
    let shift = -DVec3::new(hips.x, low.y, axis_z);
    for p in avatar
        .mesh
        .positions
        .iter_mut()
        .chain(&mut avatar.bone_heads)
        .chain(eyes.iter_mut().flatten())
    {
        *p += shift;
    }
}

/// Weights of all bones while they are accumulated
type AllWeights = PerBone<f64>;

fn skin_weights(all: &[AllWeights]) -> Vec<SkinWeight> {
    all.iter().map(SkinWeight::from_all).collect()
}

#[cfg(test)]
mod tests;

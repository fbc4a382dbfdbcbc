//! Maps the nodes of a rig to bones: by the humanoid tables of VRM, otherwise by common names.

use serde_json::Value;

use super::document::{Document, Node};
use crate::{Bone, PerBone};

/// The relevant nodes of a rig
#[derive(Debug, Clone)]
pub(super) struct Rig {
    /// One node per bone, where the rig has it
    pub(super) bones: PerBone<Option<usize>>,
    /// Eyeballs, left and right
    pub(super) eyes: [Option<usize>; 2],
}

/// The body part that a name denotes, without the side
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Hips,
    Neck,
    Head,
    Clavicle,
    UpperArm,
    Forearm,
    Hand,
    Thigh,
    Shin,
    Foot,
    Eye,
}

/// Names of parts in rigs that name bones, most specific first: MakeHuman, VRM, Mixamo, Unreal, Biped, Rigify
const BONE_NAMES: [(Part, &[&str]); 11] = [
    (Part::Hips, &["hips", "pelvis", "hip", "root"]),
    (Part::Neck, &["neck01", "neck1", "neck"]),
    (Part::Head, &["head"]),
    (
        Part::Clavicle,
        &["clavicle", "collar", "collarbone", "shoulder"],
    ),
    (Part::UpperArm, &["upperarm01", "upperarm", "arm"]),
    (Part::Forearm, &["lowerarm01", "lowerarm", "forearm"]),
    (Part::Hand, &["wrist", "hand"]),
    (Part::Thigh, &["upperleg01", "upperleg", "thigh", "upleg"]),
    (
        Part::Shin,
        &["lowerleg01", "lowerleg", "shin", "calf", "leg"],
    ),
    (Part::Foot, &["foot", "ankle"]),
    (Part::Eye, &["eye"]),
];

/// Names of parts in rigs that name the joint at which a bone starts, as body models in research do
const JOINT_NAMES: [(Part, &[&str]); 11] = [
    (Part::Hips, &["pelvis", "hips", "root"]),
    (Part::Neck, &["neck"]),
    (Part::Head, &["head"]),
    (Part::Clavicle, &["collar", "clavicle"]),
    (Part::UpperArm, &["shoulder"]),
    (Part::Forearm, &["elbow"]),
    (Part::Hand, &["wrist"]),
    (Part::Thigh, &["hip"]),
    (Part::Shin, &["knee"]),
    (Part::Foot, &["ankle"]),
    (Part::Eye, &["eye"]),
];

/// Prefixes that rigs put in front of every name
const PREFIXES: [&str; 6] = ["mixamorig", "jbip", "bip", "def", "org", "smplx"];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

/// A name without prefix, side, case and punctuation
#[derive(Debug, PartialEq, Eq)]
struct PlainName {
    side: Option<Side>,
    base: String,
}

impl PlainName {
    fn of(name: &str) -> Self {
        let name = name.rsplit(':').next().unwrap_or(name);
        let mut side = None;
        let mut words: Vec<String> = Vec::new();
        for word in split_words(name) {
            match word.as_str() {
                "l" | "left" => side = side.or(Some(Side::Left)),
                "r" | "right" => side = side.or(Some(Side::Right)),
                // "center"
                "c" => {}
                _ => words.push(word),
            }
        }
        let joined = words.concat();
        let stripped = PREFIXES.iter().find_map(|prefix| {
            let rest = joined.strip_prefix(prefix)?;
            // "mixamorig1", "bip001"
            Some(rest.trim_start_matches(|c: char| c.is_ascii_digit()))
        });
        let base = match stripped {
            Some(rest) if !rest.is_empty() => rest.to_owned(),
            _ => joined,
        };
        Self { side, base }
    }
}

/// Lower-case words, split at punctuation and where a capital or a digit follows a small letter
fn split_words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut previous = ' ';
    for c in name.chars() {
        let starts = c.is_ascii_uppercase() && previous.is_ascii_lowercase();
        if starts || !c.is_ascii_alphanumeric() {
            words.push(String::new());
        }
        if c.is_ascii_alphanumeric()
            && let Some(word) = words.last_mut()
        {
            word.push(c.to_ascii_lowercase());
        }
        previous = c;
    }
    words.retain(|word| !word.is_empty());
    words
}

fn part_of(bone: Bone) -> Option<(Part, Option<Side>)> {
    use Bone::*;
    let (left, right) = (Some(Side::Left), Some(Side::Right));
    Some(match bone {
        Root => (Part::Hips, None),
        // found by structure: rigs number their spines in too many ways
        LowerSpine | UpperSpine => return None,
        Neck => (Part::Neck, None),
        Head => (Part::Head, None),
        LeftClavicle => (Part::Clavicle, left),
        LeftUpperArm => (Part::UpperArm, left),
        LeftForearm => (Part::Forearm, left),
        LeftHand => (Part::Hand, left),
        LeftThigh => (Part::Thigh, left),
        LeftShin => (Part::Shin, left),
        LeftFoot => (Part::Foot, left),
        RightClavicle => (Part::Clavicle, right),
        RightUpperArm => (Part::UpperArm, right),
        RightForearm => (Part::Forearm, right),
        RightHand => (Part::Hand, right),
        RightThigh => (Part::Thigh, right),
        RightShin => (Part::Shin, right),
        RightFoot => (Part::Foot, right),
    })
}

/// Returns whether a rig may lack a bone; such bones are interpolated between the others
pub(super) fn is_optional(bone: Bone) -> bool {
    matches!(
        bone,
        Bone::LowerSpine | Bone::UpperSpine | Bone::Neck | Bone::LeftClavicle | Bone::RightClavicle
    )
}

impl Rig {
    /// Finds the bones of a file: by its VRM table if present, otherwise by names among `candidates`
    ///
    /// The spine is excluded; it is found by structure.
    pub(super) fn find(document: &Document, candidates: &[usize]) -> Self {
        if let Some(rig) = Self::from_vrm(document) {
            return rig;
        }
        let names: Vec<(usize, PlainName)> = candidates
            .iter()
            .filter_map(|&n| Some((n, PlainName::of(&document.root.nodes.get(n)?.name))))
            .collect();
        let by_bone = Self::from_names(&names, &BONE_NAMES);
        let by_joint = Self::from_names(&names, &JOINT_NAMES);
        if by_joint.found() > by_bone.found() {
            by_joint
        } else {
            by_bone
        }
    }

    fn found(&self) -> usize {
        self.bones.iter().flatten().count()
    }

    fn from_names(names: &[(usize, PlainName)], table: &[(Part, &[&str])]) -> Self {
        let find = |part: Part, side: Option<Side>| -> Option<usize> {
            let (_, aliases) = table.iter().find(|(p, _)| *p == part)?;
            aliases.iter().find_map(|alias| {
                let (node, _) = names
                    .iter()
                    .find(|(_, name)| name.side == side && name.base == *alias)?;
                Some(*node)
            })
        };
        let mut bones = PerBone::splat(None);
        for bone in Bone::ALL {
            if let Some((part, side)) = part_of(bone) {
                bones[bone] = find(part, side);
            }
        }
        Self {
            bones,
            eyes: [Side::Left, Side::Right].map(|side| find(Part::Eye, Some(side))),
        }
    }

    /// Reads the humanoid table of VRM 1.0 (`VRMC_vrm`, an object) or VRM 0.x (`VRM`, a list)
    fn from_vrm(document: &Document) -> Option<Self> {
        let extensions = &document.root.extensions;
        let new = &extensions["VRMC_vrm"]["humanoid"]["humanBones"];
        let old = &extensions["VRM"]["humanoid"]["humanBones"];
        if !new.is_object() && !old.is_array() {
            return None;
        }
        let node_of = |name: &str| -> Option<usize> {
            let entry = match old.as_array() {
                Some(list) if !new.is_object() => {
                    list.iter().find(|e| e["bone"].as_str() == Some(name))?
                }
                _ => &new[name],
            };
            let node = entry.get("node").and_then(Value::as_u64)? as usize;
            (node < document.root.nodes.len()).then_some(node)
        };
        let mut bones = PerBone::splat(None);
        for bone in Bone::ALL {
            bones[bone] = vrm_name(bone).and_then(node_of);
        }
        Some(Self {
            bones,
            eyes: ["leftEye", "rightEye"].map(node_of),
        })
    }
}

pub(super) fn vrm_name(bone: Bone) -> Option<&'static str> {
    use Bone::*;
    Some(match bone {
        Root => "hips",
        LowerSpine | UpperSpine => return None,
        Neck => "neck",
        Head => "head",
        LeftClavicle => "leftShoulder",
        LeftUpperArm => "leftUpperArm",
        LeftForearm => "leftLowerArm",
        LeftHand => "leftHand",
        LeftThigh => "leftUpperLeg",
        LeftShin => "leftLowerLeg",
        LeftFoot => "leftFoot",
        RightClavicle => "rightShoulder",
        RightUpperArm => "rightUpperArm",
        RightForearm => "rightLowerArm",
        RightHand => "rightHand",
        RightThigh => "rightUpperLeg",
        RightShin => "rightLowerLeg",
        RightFoot => "rightFoot",
    })
}

/// Returns the parent of each node; cycles and second parents of invalid files are removed
pub(super) fn parents(nodes: &[Node]) -> Vec<Option<usize>> {
    let mut parents = vec![None; nodes.len()];
    for (n, node) in nodes.iter().enumerate() {
        for &child in &node.children {
            if child < nodes.len() && parents[child].is_none() && child != n {
                parents[child] = Some(n);
            }
        }
    }
    // walk up from every node; the first step into the current path is a cycle
    let mut settled = vec![false; nodes.len()];
    for start in 0..nodes.len() {
        let mut trail = vec![start];
        let mut on_trail = std::collections::BTreeSet::from([start]);
        while let Some(&last) = trail.last()
            && !settled[last]
            && let Some(parent) = parents[last]
        {
            if !on_trail.insert(parent) {
                parents[last] = None;
                break;
            }
            trail.push(parent);
        }
        for n in trail {
            settled[n] = true;
        }
    }
    parents
}

/// Returns a node and all its ancestors, nearest first
pub(super) fn ancestors(
    parents: &[Option<usize>],
    node: usize,
) -> impl Iterator<Item = usize> + '_ {
    std::iter::successors(Some(node), |&n| parents.get(n).copied().flatten())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_all_rigs_lose_prefix_side_and_case() {
        let plain = |name: &str| {
            let PlainName { side, base } = PlainName::of(name);
            let side = match side {
                Some(Side::Left) => "L ",
                Some(Side::Right) => "R ",
                None => "",
            };
            format!("{side}{base}")
        };
        assert_eq!(plain("mixamorig:LeftForeArm"), "L forearm");
        assert_eq!(plain("mixamorig1:RightUpLeg"), "R upleg");
        assert_eq!(plain("mixamorigHips"), "hips");
        assert_eq!(plain("upperarm01.L"), "L upperarm01");
        assert_eq!(plain("upperarm_l"), "L upperarm");
        assert_eq!(plain("THIGH_R"), "R thigh");
        assert_eq!(plain("leftUpperArm"), "L upperarm");
        assert_eq!(plain("J_Bip_L_UpperArm"), "L upperarm");
        assert_eq!(plain("Bip001 L Calf"), "L calf");
        assert_eq!(plain("neck_01"), "neck01");
        assert_eq!(plain("DEF-shin.R"), "R shin");
        assert_eq!(plain("root"), "root");
    }

    fn rig(names: &[&str]) -> Rig {
        let nodes: Vec<String> = names
            .iter()
            .map(|name| format!(r#"{{"name":"{name}"}}"#))
            .collect();
        let json = format!(r#"{{"nodes":[{}]}}"#, nodes.join(","));
        let document = Document::parse(json.as_bytes()).unwrap();
        let all: Vec<usize> = (0..names.len()).collect();
        Rig::find(&document, &all)
    }

    #[test]
    fn bone_and_joint_names_are_distinguished() {
        let bones = rig(&[
            "Hips",
            "Neck",
            "Head",
            "LeftShoulder",
            "LeftArm",
            "LeftForeArm",
            "LeftHand",
            "LeftUpLeg",
            "LeftLeg",
            "LeftFoot",
        ]);
        assert_eq!(bones.bones[Bone::LeftClavicle], Some(3));
        assert_eq!(bones.bones[Bone::LeftUpperArm], Some(4));
        assert_eq!(bones.bones[Bone::LeftShin], Some(8));
        let joints = rig(&[
            "Pelvis",
            "Neck",
            "Head",
            "L_Collar",
            "L_Shoulder",
            "L_Elbow",
            "L_Wrist",
            "L_Hip",
            "L_Knee",
            "L_Ankle",
        ]);
        assert_eq!(joints.bones[Bone::LeftClavicle], Some(3));
        assert_eq!(joints.bones[Bone::LeftUpperArm], Some(4));
        assert_eq!(joints.bones[Bone::LeftShin], Some(8));
    }

    #[test]
    fn the_hips_take_precedence_over_a_root_on_the_floor() {
        let rig = rig(&["root", "pelvis", "thigh_l"]);
        assert_eq!(rig.bones[Bone::Root], Some(1));
    }

    #[test]
    fn cycles_are_removed() {
        let json = r#"{"nodes":[{"children":[1]},{"children":[2]},{"children":[0,2,9]},{"children":[1]}]}"#;
        let document = Document::parse(json.as_bytes()).unwrap();
        let parents = parents(&document.root.nodes);
        for n in 0..4 {
            assert!(ancestors(&parents, n).count() <= 4);
        }
    }
}

//! The skinned surface of a file, welded along its seams.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat4, DVec3};
use pirouette_geom::TriMesh;

use super::document::{Document, Primitive};
use super::{AllWeights, LoadAvatarError, skin_weights};
use crate::{Bone, PerBone, SkinWeight};

/// Vertices on open borders closer than about this, in the file's unit, are merged
///
/// Exporters repeat vertices along seams of normals and textures bit by bit, so this only absorbs the rounding of
/// skinning.
const WELD_DISTANCE: f64 = 1e-6;

/// A part of at least this share of the total height is the body; the others are eyes, teeth, hair or clothes
const WHOLE_BODY_SHARE: f64 = 0.9;

/// Parts with less than this share of the area are dropped even if no part is the complete body
const SCRAP_SHARE: f64 = 0.01;

/// What happens to primitives without joints
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Unbound {
    Skipped,
    /// They follow the first joint
    FirstJoint,
}

/// Triangles with the weights of all bones per vertex
#[derive(Debug, Default)]
pub(super) struct Surface {
    pub(super) positions: Vec<DVec3>,
    pub(super) weights: Vec<AllWeights>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// Adds the primitives of a mesh in the pose of its rig
    pub(super) fn add_skinned_mesh(
        &mut self,
        document: &Document,
        mesh: usize,
        skin: usize,
        world_from_node: &[DMat4],
        bone_of_node: &[Bone],
    ) -> Result<(), LoadAvatarError> {
        let fail = || LoadAvatarError::Index { mesh };
        let skin = document.root.skins.get(skin).ok_or_else(fail)?;
        if skin.joints.iter().any(|&joint| joint >= bone_of_node.len()) {
            return Err(fail());
        }
        let node_from_mesh = match skin.inverse_bind_matrices {
            None => vec![DMat4::IDENTITY; skin.joints.len()],
            Some(accessor) => document
                .read::<16>(accessor)?
                .iter()
                .map(DMat4::from_cols_array)
                .collect(),
        };
        if node_from_mesh.len() < skin.joints.len() {
            return Err(fail());
        }
        let joints: Vec<(DMat4, Bone)> = skin
            .joints
            .iter()
            .zip(&node_from_mesh)
            .map(|(&joint, &from_mesh)| (world_from_node[joint] * from_mesh, bone_of_node[joint]))
            .collect();
        let primitives = &document.root.meshes.get(mesh).ok_or_else(fail)?.primitives;
        for primitive in primitives {
            self.add_primitive(document, mesh, primitive, &joints, Unbound::Skipped)?;
        }
        Ok(())
    }

    /// Adds the primitives of a mesh without skin, which move with their node
    pub(super) fn add_rigid_mesh(
        &mut self,
        document: &Document,
        mesh: usize,
        world_from_node: DMat4,
    ) -> Result<(), LoadAvatarError> {
        let fail = || LoadAvatarError::Index { mesh };
        let primitives = &document.root.meshes.get(mesh).ok_or_else(fail)?.primitives;
        let joints = [(world_from_node, Bone::Root)];
        for primitive in primitives {
            self.add_primitive(document, mesh, primitive, &joints, Unbound::FirstJoint)?;
        }
        Ok(())
    }

    fn add_primitive(
        &mut self,
        document: &Document,
        mesh: usize,
        primitive: &Primitive,
        joints: &[(DMat4, Bone)],
        unbound: Unbound,
    ) -> Result<(), LoadAvatarError> {
        let fail = || LoadAvatarError::Index { mesh };
        let attribute = |name: &str| primitive.attributes.get(name).copied();
        let Some(position_accessor) = attribute("POSITION") else {
            return Ok(());
        };
        let positions = document.read::<3>(position_accessor)?;
        // up to eight influences, in sets of four
        let mut influences = Vec::new();
        for set in 0..2 {
            let names = (format!("JOINTS_{set}"), format!("WEIGHTS_{set}"));
            if let (Some(joints), Some(weights)) = (attribute(&names.0), attribute(&names.1)) {
                let (joints, weights) = (document.read::<4>(joints)?, document.read::<4>(weights)?);
                if joints.len() < positions.len() || weights.len() < positions.len() {
                    return Err(fail());
                }
                influences.push((joints, weights));
            }
        }
        if influences.is_empty() && unbound == Unbound::Skipped {
            return Ok(());
        }
        let indices: Vec<u32> = match primitive.indices {
            None => (0..positions.len() as u32).collect(),
            Some(accessor) => document
                .read::<1>(accessor)?
                .into_iter()
                .map(|[index]| index as u32)
                .collect(),
        };
        if indices.iter().any(|&i| i as usize >= positions.len()) {
            return Err(fail());
        }

        let first = self.positions.len() as u32;
        for (v, position) in positions.iter().enumerate() {
            let (mut all, mut skinned, mut sum) = (PerBone::splat(0.0), DVec3::ZERO, 0.0);
            let position = DVec3::from_array(*position);
            for (joint_sets, weight_sets) in &influences {
                for (&joint, &weight) in joint_sets[v].iter().zip(&weight_sets[v]) {
                    // also drops NaN
                    if !(weight > 0.0 && weight.is_finite()) {
                        continue;
                    }
                    let &(transform, bone) = joints.get(joint as usize).ok_or_else(fail)?;
                    all[bone] += weight;
                    skinned += transform.transform_point3(position) * weight;
                    sum += weight;
                }
            }
            // A vertex without joint influences follows the first joint.
            let skinned = match joints.first() {
                Some((transform, _)) if sum <= 0.0 => transform.transform_point3(position),
                _ => skinned / sum,
            };
            self.positions.push(skinned);
            self.weights
                .push(all.map(|w| if sum > 0.0 { w / sum } else { 0.0 }));
        }
        let at = |i: usize| first + indices[i];
        match primitive.mode.unwrap_or(4) {
            4 => {
                for t in 0..indices.len() / 3 {
                    self.triangles
                        .push([at(3 * t), at(3 * t + 1), at(3 * t + 2)]);
                }
            }
            5 => {
                for t in 2..indices.len() {
                    let (a, b) = if t % 2 == 0 {
                        (t - 2, t - 1)
                    } else {
                        (t - 1, t - 2)
                    };
                    self.triangles.push([at(a), at(b), at(t)]);
                }
            }
            6 => {
                for t in 2..indices.len() {
                    self.triangles.push([at(0), at(t - 1), at(t)]);
                }
            }
            // points and lines
            _ => {}
        }
        Ok(())
    }

    /// Merges coincident vertices on open borders, where exporters cut a surface into charts
    ///
    /// Restricted to borders: lips and eyelids touch without being connected.
    pub(super) fn weld(&mut self) {
        let directed: BTreeSet<[u32; 2]> = self
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .collect();
        let border: BTreeSet<u32> = directed
            .iter()
            .filter(|&&[a, b]| !directed.contains(&[b, a]))
            .flatten()
            .copied()
            .collect();
        let mut places: BTreeMap<[i64; 3], u32> = BTreeMap::new();
        let mut kept: Vec<u32> = (0..self.positions.len() as u32).collect();
        let mut merged: BTreeMap<u32, f64> = BTreeMap::new();
        for v in border {
            let place = (self.positions[v as usize] / WELD_DISTANCE).round();
            let cell = place.to_array().map(|x| x as i64);
            let first = *places.entry(cell).or_insert(v);
            kept[v as usize] = first;
            if first != v {
                let count = merged.entry(first).or_insert(1.0);
                *count += 1.0;
                let (from, to) = (self.weights[v as usize], &mut self.weights[first as usize]);
                for (to, from) in to.iter_mut().zip(from) {
                    *to += (from - *to) / *count;
                }
            }
        }
        for triangle in &mut self.triangles {
            *triangle = triangle.map(|v| kept[v as usize]);
        }
        self.triangles
            .retain(|&[a, b, c]| a != b && b != c && c != a);
    }

    /// Drops loose parts: all but the largest if that is a complete body, otherwise only scraps
    pub(super) fn keep_the_body(&mut self) {
        let part_of = self.parts();
        let Some(bounds) = bounds(&self.positions, self.triangles.iter().flatten()) else {
            return;
        };
        let mut areas: BTreeMap<u32, f64> = BTreeMap::new();
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|v| self.positions[v as usize]);
            *areas.entry(part_of[triangle[0] as usize]).or_default() +=
                (b - a).cross(c - a).length() / 2.0;
        }
        let total: f64 = areas.values().sum();
        let Some((&largest, _)) = areas.iter().max_by(|a, b| a.1.total_cmp(b.1)) else {
            return;
        };
        let of_largest = self
            .triangles
            .iter()
            .filter(|t| part_of[t[0] as usize] == largest)
            .flatten();
        let height = |(low, high): (DVec3, DVec3)| high.y - low.y;
        let whole = super::surface::bounds(&self.positions, of_largest)
            .is_some_and(|part| height(part) >= WHOLE_BODY_SHARE * height(bounds));
        self.triangles.retain(|t| {
            let part = part_of[t[0] as usize];
            if whole {
                part == largest
            } else {
                areas
                    .get(&part)
                    .is_some_and(|area| *area >= SCRAP_SHARE * total)
            }
        });
    }

    /// For each vertex the lowest vertex that triangles connect it with
    fn parts(&self) -> Vec<u32> {
        let mut parent: Vec<u32> = (0..self.positions.len() as u32).collect();
        fn find(parent: &mut [u32], mut v: u32) -> u32 {
            while parent[v as usize] != v {
                parent[v as usize] = parent[parent[v as usize] as usize];
                v = parent[v as usize];
            }
            v
        }
        for &[a, b, c] in &self.triangles {
            for (u, v) in [(a, b), (b, c)] {
                let (u, v) = (find(&mut parent, u), find(&mut parent, v));
                parent[u.max(v) as usize] = u.min(v);
            }
        }
        (0..parent.len() as u32)
            .map(|v| find(&mut parent, v))
            .collect()
    }

    /// Flips all triangles where mirroring nodes left the surface inside out
    pub(super) fn face_outward(&mut self) {
        let volume: f64 = self
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| self.positions[v as usize]);
                a.dot(b.cross(c))
            })
            .sum();
        if volume < 0.0 {
            for triangle in &mut self.triangles {
                triangle.swap(1, 2);
            }
        }
    }

    /// Removes unused vertices
    pub(super) fn compact(&mut self) {
        let mut new_index = vec![u32::MAX; self.positions.len()];
        let (mut positions, mut weights) = (Vec::new(), Vec::new());
        for v in self.triangles.iter_mut().flatten() {
            let old = *v as usize;
            if new_index[old] == u32::MAX {
                new_index[old] = positions.len() as u32;
                positions.push(self.positions[old]);
                weights.push(self.weights[old]);
            }
            *v = new_index[old];
        }
        (self.positions, self.weights) = (positions, weights);
    }

    /// Returns the triangles without weights
    pub(super) fn mesh(&self) -> TriMesh {
        TriMesh {
            positions: self.positions.clone(),
            triangles: self.triangles.clone(),
        }
    }

    /// Returns the mesh and its weights
    pub(super) fn into_mesh(self) -> (TriMesh, Vec<SkinWeight>) {
        let weights = skin_weights(&self.weights);
        let mesh = TriMesh {
            positions: self.positions,
            triangles: self.triangles,
        };
        (mesh, weights)
    }
}

/// Returns the smallest and largest coordinates of some vertices
fn bounds<'a>(
    positions: &[DVec3],
    vertices: impl Iterator<Item = &'a u32>,
) -> Option<(DVec3, DVec3)> {
    vertices
        .map(|&v| positions[v as usize])
        .fold(None, |bounds, p| {
            let (low, high) = bounds.unwrap_or((p, p));
            Some((p.min(low), p.max(high)))
        })
}

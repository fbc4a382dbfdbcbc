//! Clothing of the person, and compositing of the photos.

use glam::DVec3;
use pirouette_geom::Grid;

use super::appearance::{Appearance, Lighting};
use super::random::{Random, noise, rough_noise};
use super::room::{Light, hue};
use super::wardrobe::{Dressed, Hems, Material};
use pirouette_body::{Avatar, Bone, Camera, Joint, render};

/// Colors and clothing of one person
#[derive(Debug, Clone)]
pub(super) struct Look {
    seed: u64,
    mesh: render::SilhouetteMesh,
    /// Reference position of each vertex, interpolated by the renderer in place of a color
    places: Vec<[f32; 3]>,
    segments: Vec<(Bone, DVec3, DVec3)>,
    eyes: DVec3,
    stature_mm: f64,
    skin: DVec3,
    hair: DVec3,
    shirt: DVec3,
    shorts: DVec3,
    shoes: DVec3,
    stripes: bool,
    sleeve: f64,
    leg: f64,
    lighting: Lighting,
    hems: Option<Hems>,
    hat: DVec3,
}

/// Distance along x, in mm, by which the places of each further material are moved
///
/// The renderer interpolates three numbers: the place also encodes the material. Pieces share no triangles with the body.
const MATERIAL_MM: f64 = 16384.0;

impl Look {
    pub(super) fn dressed(dressed: &Dressed, seed: u64, appearance: &Appearance) -> Self {
        let mut look = Self::new(&dressed.avatar, seed, appearance);
        look.hems = Some(dressed.hems);
        let painted = dressed.places.iter().zip(&dressed.materials);
        look.places = painted
            .map(|(place, material)| {
                let aside = DVec3::X * MATERIAL_MM * f64::from(*material as u8);
                (*place + aside).to_array().map(|v| v as f32)
            })
            .collect();
        look
    }

    pub(super) fn new(avatar: &Avatar, seed: u64, appearance: &Appearance) -> Self {
        let random = &mut Random::new(seed ^ 0x00c1_07e5);
        // Drawn in any case, so that clothes do not depend on the skin.
        let drawn = random.between(0.25, 1.0);
        let tone = appearance.skin_tone.unwrap_or(drawn);
        let head = |bone: Bone| avatar.bone_heads[bone];
        let point = |joint: Joint| avatar.keypoints[joint];
        let segments = Bone::ALL
            .iter()
            .map(|&bone| {
                let from = head(bone);
                let to = match bone {
                    Bone::Root => head(Bone::LowerSpine),
                    Bone::LowerSpine => head(Bone::UpperSpine),
                    Bone::UpperSpine => head(Bone::Neck),
                    Bone::Neck => head(Bone::Head),
                    Bone::Head => from + DVec3::Y * 0.1 * avatar.stature_mm(),
                    Bone::LeftHand => from * 2.0 - (head(Bone::LeftForearm) + from) / 2.0,
                    Bone::RightHand => from * 2.0 - (head(Bone::RightForearm) + from) / 2.0,
                    Bone::LeftFoot => point(Joint::LeftBigToe),
                    Bone::RightFoot => point(Joint::RightBigToe),
                    _ => Bone::ALL
                        .iter()
                        .find(|b| b.parent() == Some(bone))
                        .map_or(from, |&b| head(b)),
                };
                (bone, from, to)
            })
            .collect();
        Self {
            seed,
            mesh: render::SilhouetteMesh::new(&avatar.mesh.triangles),
            places: avatar
                .mesh
                .positions
                .iter()
                .map(|p| p.to_array().map(|v| v as f32))
                .collect(),
            segments,
            eyes: (point(Joint::LeftEye) + point(Joint::RightEye)) / 2.0,
            stature_mm: avatar.stature_mm(),
            skin: DVec3::new(0.72, 0.45, 0.33) * (0.25 + 0.75 * tone),
            hair: DVec3::new(0.12, 0.075, 0.045) * random.between(0.3, 2.5),
            shirt: hue(random, 0.08, 0.5, 0.9),
            shorts: hue(random, 0.04, 0.25, 0.6),
            shoes: hue(random, 0.03, 0.5, 0.3),
            stripes: random.uniform() < 0.5,
            sleeve: random.between(0.35, 0.8),
            leg: random.between(0.4, 0.9),
            lighting: appearance.lighting,
            hems: None,
            hat: hue(random, 0.05, 0.5, 0.7),
        }
    }

    /// Renders the person in front of the room; `positions` are the posed vertices
    pub(super) fn paint(&self, background: &Light, positions: &[DVec3], camera: &Camera) -> Light {
        let mut layer = render::shade_layer(
            &self.mesh,
            positions,
            camera,
            |place| self.albedo(DVec3::from_array(place.map(f64::from))),
            Some(&self.places),
        );
        self.lighting
            .light_person(&mut layer, &self.mesh, positions, camera);
        let feet = self.feet(positions);
        Grid::from_fn(camera.width_px, camera.height_px, |x, y| {
            let alpha = layer.coverage[(x, y)];
            let behind = background[(x, y)];
            if alpha >= 1.0 {
                return layer.color[(x, y)];
            }
            let shade = self.contact_shadow(x, y, camera, feet);
            let front = layer.color[(x, y)];
            std::array::from_fn(|k| behind[k] * shade * (1.0 - alpha) + front[k] * alpha)
        })
    }

    /// Returns the middle of the soles on the floor
    fn feet(&self, positions: &[DVec3]) -> DVec3 {
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for p in positions.iter().filter(|p| p.y < 0.03 * self.stature_mm) {
            sum += *p;
            count += 1.0;
        }
        if count > 0.0 {
            sum / count
        } else {
            DVec3::ZERO
        }
    }

    /// Returns the share of light that the person leaves on the floor around the feet, 0 to 1
    fn contact_shadow(&self, x: usize, y: usize, camera: &Camera, feet: DVec3) -> f32 {
        let ray = camera.ray(glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        if ray.y >= -1e-6 {
            return 1.0;
        }
        let floor = camera.center() - ray * (camera.center().y / ray.y);
        let away = (floor - feet).length() / (0.16 * self.stature_mm);
        (1.0 - 0.55 * (-away * away).exp()) as f32
    }

    /// Returns the color of a point of the reference pose
    fn albedo(&self, place: DVec3) -> [f32; 3] {
        let material = (place.x / MATERIAL_MM).round();
        let place = place - DVec3::X * MATERIAL_MM * material;
        let is = |other: Material| material == f64::from(other as u8);
        let (bone, along) = self.nearest_bone(place);
        let weave = 0.92 + 0.16 * noise(place / 5.0, self.seed);
        let folds = 0.85 + 0.3 * rough_noise(place / DVec3::new(60.0, 140.0, 60.0), self.seed ^ 11);
        let shirt = |stripes: bool| {
            let dark = stripes && (place.y / 45.0).rem_euclid(2.0) < 1.0;
            self.shirt * weave * folds * if dark { 0.55 } else { 1.0 }
        };
        let skin = self.skin * (0.96 + 0.08 * noise(place / 12.0, self.seed ^ 12));
        let worn = match &self.hems {
            _ if is(Material::Hair) => Some(self.strands(place)),
            _ if is(Material::Hat) => Some(self.hat * weave),
            _ if is(Material::Skirt) => Some(self.shorts * weave * folds),
            Some(hems) => Part::of(bone, along, place, hems).map(|part| match part {
                Part::Top => shirt(self.stripes),
                Part::Bottom => self.shorts * weave * folds,
                Part::Skin => skin,
            }),
            None => None,
        };
        if let Some(color) = worn {
            return color.to_array().map(|v| v as f32);
        }
        let color = match bone {
            Bone::LowerSpine | Bone::UpperSpine | Bone::LeftClavicle | Bone::RightClavicle => {
                shirt(self.stripes)
            }
            Bone::LeftUpperArm | Bone::RightUpperArm if along < self.sleeve => shirt(self.stripes),
            Bone::Root => self.shorts * weave * folds,
            Bone::LeftThigh | Bone::RightThigh if along < self.leg => self.shorts * weave * folds,
            Bone::LeftFoot | Bone::RightFoot => self.shoes * weave,
            Bone::Head => self.face(place, skin),
            _ => skin,
        };
        color.to_array().map(|v| v as f32)
    }

    fn face(&self, place: DVec3, skin: DVec3) -> DVec3 {
        let up = (place.y - self.eyes.y) / self.stature_mm;
        let ahead = (place.z - self.eyes.z) / self.stature_mm;
        let hairline = 0.035 + 0.004 * noise(place / 15.0, self.seed ^ 13);
        // hair: above the hairline, and behind the ears down to the nape
        if up > hairline || (ahead < -0.055 && up > -0.035) {
            return self.strands(place);
        }
        skin
    }

    /// Returns the color of hair
    fn strands(&self, place: DVec3) -> DVec3 {
        self.hair * (0.7 + 0.6 * noise(place / DVec3::new(4.0, 40.0, 4.0), self.seed ^ 14))
    }

    /// Returns the bone nearest to a point of the reference pose, and the position along it (0 to 1)
    fn nearest_bone(&self, place: DVec3) -> (Bone, f64) {
        let mut nearest = (f64::INFINITY, Bone::Root, 0.0);
        for &(bone, from, to) in &self.segments {
            let axis = to - from;
            let along = ((place - from).dot(axis) / axis.length_squared().max(1.0)).clamp(0.0, 1.0);
            let distance = (place - from - axis * along).length_squared();
            if distance < nearest.0 {
                nearest = (distance, bone, along);
            }
        }
        (nearest.1, nearest.2)
    }
}

/// What covers a point of trunk, arms and legs
enum Part {
    Top,
    Bottom,
    Skin,
}

impl Part {
    /// Returns what covers a point by its nearest bone and the position along it; `None` for head, hands and feet
    fn of(bone: Bone, along: f64, place: DVec3, hems: &Hems) -> Option<Self> {
        use Bone::*;
        let covered = |covered: bool, part: Self| Some(if covered { part } else { Self::Skin });
        let lower = if place.y > hems.top_mm {
            Self::Top
        } else {
            Self::Bottom
        };
        match bone {
            Root | LowerSpine | UpperSpine | LeftClavicle | RightClavicle => Some(lower),
            LeftThigh | RightThigh if place.y > hems.top_mm => Some(Self::Top),
            LeftThigh | RightThigh => covered(along < hems.leg, Self::Bottom),
            LeftShin | RightShin => covered(1.0 + along < hems.leg, Self::Bottom),
            LeftUpperArm | RightUpperArm => covered(along < hems.sleeve, Self::Top),
            LeftForearm | RightForearm => covered(1.0 + along < hems.sleeve, Self::Top),
            _ => None,
        }
    }
}

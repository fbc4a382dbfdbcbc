//! Clothes, shoes and hair of rendered people, by simple geometry.
//!
//! Garments and shoes displace the surface of the body outward: cloth bridges hollows, hangs from what is above, and has
//! a given ease. Skirts, hats and the volume of long hair are additional closed pieces. No cloth is simulated: folds are
//! smooth noise, and garments move with the bones below them.

mod body;
mod garments;
mod pieces;
mod polar;

use glam::DVec3;
use pirouette_body::Avatar;
use pirouette_geom::TriMesh;

use crate::random::Random;
use body::Marks;

/// What a person wears
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outfit {
    /// Hair, or a hat
    pub hair: Hair,
    /// Thickness of the soles of the shoes, in mm; 0 is barefoot
    pub sole_mm: f64,
    /// Garment of trunk and arms
    pub top: Garment,
    /// End of its sleeves: 0 at the shoulder, 1 at the elbow, 2 at the wrist
    pub sleeve: f64,
    /// Garment of hips and legs
    pub bottom: Bottom,
}

/// Hair, or what covers it
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hair {
    /// No volume: the skull
    Shaved,
    /// Hair of 10 mm over the skull, and a ball of 80 mm at the back of the head
    Bun,
    /// Hair of 10 mm over the skull, and 25 mm thick over neck and upper back
    Long,
    /// A ball with 1.35 times the radius of the skull
    Afro,
    /// A hat whose crown is 40 mm higher than the skull, with a brim
    Hat,
}

impl Hair {
    /// All kinds of hair
    pub const ALL: [Hair; 5] = [Hair::Shaved, Hair::Bun, Hair::Long, Hair::Afro, Hair::Hat];

    /// Returns a name for tables
    pub fn name(self) -> &'static str {
        match self {
            Hair::Shaved => "shaved",
            Hair::Bun => "bun",
            Hair::Long => "long hair",
            Hair::Afro => "afro",
            Hair::Hat => "hat",
        }
    }
}

/// Width of a garment
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Garment {
    /// Girth in addition to that of the trunk below it, in mm; 0 follows the body
    pub ease_mm: f64,
    /// Largest height of the folds, in mm
    pub folds_mm: f64,
}

/// Garment of hips and legs
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bottom {
    /// From the waist to above the ankles; the ease is that at the hips, legs have somewhat less
    Trousers(Garment),
    /// A tube around both legs
    Skirt {
        /// Girth in addition to that of the hips, in mm
        ease_mm: f64,
        /// How much the radius grows below the hips, in mm per mm
        flare: f64,
        /// Position of the hem: 0 at the hip joints, 1 at the ankles
        hem: f64,
    },
}

impl Outfit {
    /// Returns clothes as tight as skin
    pub fn tight() -> Self {
        let tight = Garment {
            ease_mm: 0.0,
            folds_mm: 0.0,
        };
        Self {
            hair: Hair::Shaved,
            sole_mm: 0.0,
            top: tight,
            sleeve: 0.6,
            bottom: Bottom::Trousers(tight),
        }
    }

    /// Returns a shirt and trousers of usual width
    pub fn normal() -> Self {
        Self {
            top: Garment {
                ease_mm: 80.0,
                folds_mm: 4.0,
            },
            bottom: Bottom::Trousers(Garment {
                ease_mm: 50.0,
                folds_mm: 3.0,
            }),
            ..Self::tight()
        }
    }

    /// Returns a wide shirt with long sleeves and wide trousers
    pub fn loose() -> Self {
        Self {
            top: Garment {
                ease_mm: 200.0,
                folds_mm: 9.0,
            },
            sleeve: 1.9,
            bottom: Bottom::Trousers(Garment {
                ease_mm: 120.0,
                folds_mm: 7.0,
            }),
            ..Self::tight()
        }
    }

    /// Returns a shirt of usual width and a skirt to below the knees
    pub fn skirt() -> Self {
        Self {
            bottom: Bottom::Skirt {
                ease_mm: 60.0,
                flare: 0.12,
                hem: 0.6,
            },
            ..Self::normal()
        }
    }

    /// Returns random hair, shoes and clothes; equal seeds give equal outfits
    pub fn random(seed: u64) -> Self {
        let random = &mut Random::new(seed ^ 0x0dd_1e55);
        let clothes = [Self::tight(), Self::normal(), Self::loose(), Self::skirt()];
        let mut pick = |count: usize| (random.bits() % count as u64) as usize;
        let (clothes, hair, shod) = (
            clothes[pick(clothes.len())],
            Hair::ALL[pick(Hair::ALL.len())],
            pick(3) > 0,
        );
        Self {
            hair,
            sole_mm: if shod {
                random.between(20.0, 35.0)
            } else {
                0.0
            },
            ..clothes
        }
    }
}

/// What a vertex of a dressed person shows
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Material {
    /// The body or a garment that follows it, by the nearest bone
    Body,
    /// Hair
    Hair,
    /// A hat
    Hat,
    /// A skirt, in the color of the shorts
    Skirt,
}

/// A dressed person
#[derive(Debug, Clone)]
pub struct Dressed {
    /// The clothed surface with its pieces; bones and keypoints of the body, higher by the soles
    pub avatar: Avatar,
    /// Material of each vertex, same order as the positions of the surface
    pub materials: Vec<Material>,
    /// Height of the naked, barefoot body, in mm
    pub stature_mm: f64,
    /// Point of the naked body, on the soles, below each vertex, in mm; pieces have their own points
    pub(crate) places: Vec<DVec3>,
    /// Ends of the garments
    pub(crate) hems: Hems,
}

/// Ends of garments that follow the body
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hems {
    /// End of the sleeves: 1 at the elbow, 2 at the wrist
    pub(crate) sleeve: f64,
    /// End of the trousers: 1 at the knee, 2 at the ankle
    pub(crate) leg: f64,
    /// Height of the lower end of the top, in mm above the floor
    pub(crate) top_mm: f64,
}

/// A closed surface in addition to that of the body
#[derive(Debug, Clone)]
struct Piece {
    mesh: TriMesh,
    weights: Vec<pirouette_body::SkinWeight>,
    material: Material,
}

/// Dresses an avatar
///
/// Joints, keypoints and skinning of the body remain; all are higher by the soles, which stand on the floor. The seed
/// determines the folds.
pub fn dress(avatar: &Avatar, outfit: &Outfit, seed: u64) -> Dressed {
    let stature_mm = avatar.stature_mm();
    let mut marks = Marks::new(avatar);
    if let Bottom::Skirt { .. } = outfit.bottom {
        // The top is tucked in.
        marks.top_hem_mm = marks.waist_mm - 10.0;
    }
    let worn = garments::clothed(avatar, &marks, outfit, seed);
    let lift = DVec3::Y * outfit.sole_mm;
    let mut dressed = avatar.clone().shifted(lift);
    let places = dressed.mesh.positions.clone();
    let pieces = [
        pieces::hair(avatar, &worn, &marks, outfit.hair),
        pieces::skirt(avatar, &marks, outfit, seed),
    ];
    dressed.mesh.positions = worn.iter().map(|p| *p + lift).collect();
    garments::wear_shoes(&mut dressed, &marks, outfit.sole_mm);
    let mut found = Dressed {
        materials: vec![Material::Body; places.len()],
        avatar: dressed,
        stature_mm,
        places,
        hems: Hems {
            sleeve: outfit.sleeve,
            leg: match outfit.bottom {
                Bottom::Trousers(_) => marks.trouser_end(),
                Bottom::Skirt { .. } => 0.2,
            },
            top_mm: marks.top_hem_mm + outfit.sole_mm,
        },
    };
    for piece in pieces.into_iter().flatten() {
        found.append(piece, lift);
    }
    found
}

impl Dressed {
    fn append(&mut self, piece: Piece, lift: DVec3) {
        let mesh = &mut self.avatar.mesh;
        let first = mesh.positions.len() as u32;
        let count = piece.mesh.positions.len();
        let positions = piece.mesh.positions.iter().map(|p| *p + lift);
        mesh.positions.extend(positions.clone());
        self.places.extend(positions);
        let triangles = piece.mesh.triangles.iter();
        mesh.triangles
            .extend(triangles.map(|triangle| triangle.map(|v| v + first)));
        self.avatar.weights.extend(piece.weights);
        self.materials
            .extend(std::iter::repeat_n(piece.material, count));
    }
}

/// Returns 0 below `low`, 1 above `high`, and a smooth transition between
fn smooth_step(low: f64, high: f64, value: f64) -> f64 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests;

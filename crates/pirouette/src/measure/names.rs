//! The measures: names, definitions, tapes.

/// A girth, by the key used in files; paired limbs have one tape each
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub enum Girth {
    Head,
    Neck,
    Bust,
    Underbust,
    Waist,
    Hip,
    LeftThigh,
    RightThigh,
    LeftKnee,
    RightKnee,
    LeftCalf,
    RightCalf,
    LeftAnkle,
    RightAnkle,
    LeftUpperArm,
    RightUpperArm,
    LeftWrist,
    RightWrist,
}

/// A named point of the surface
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub enum Landmark {
    Crown,
    /// Seventh cervical vertebra, the nape
    Nape,
    LeftAcromion,
    RightAcromion,
    LeftBustPoint,
    RightBustPoint,
    /// Middle of the front at the natural waist
    WaistFront,
    /// Middle of the back at the natural waist
    WaistBack,
    /// Rearmost point of the seat
    Seat,
    Crotch,
    LeftWrist,
    RightWrist,
}

/// One row per measure: variant, key, definition, tapes (left limb first)
macro_rules! measures {
    ($($variant:ident, $key:literal, $definition:literal, [$($girth:ident),*];)*) => {
        /// A measure; girths are tape lengths, the perimeter of the section's convex hull
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Measure {
            $(#[doc = $definition] $variant,)*
        }

        impl Measure {
            /// All measures, in the order of files
            pub const ALL: [Measure; 24] = [$(Measure::$variant,)*];

            /// Returns the key used in files, in snake case
            pub fn name(self) -> &'static str {
                match self {
                    $(Measure::$variant => $key,)*
                }
            }

            /// Returns the definition in words
            pub fn definition(self) -> &'static str {
                match self {
                    $(Measure::$variant => $definition,)*
                }
            }

            /// Returns the tapes of a girth, left limb first; none for lengths and heights
            pub fn girths(self) -> &'static [Girth] {
                match self {
                    $(Measure::$variant => &[$(Girth::$girth),*],)*
                }
            }
        }
    };
}

measures! {
    Stature, "stature", "height of the person, floor to crown", [];
    NeckGirth, "neck_girth", "shortest tape around the neck in a plane whose front is lower by 5 degrees", [Neck];
    BustGirth, "bust_girth", "level, below the armpits, over the most forward points of the chest beside the breast bone", [Bust];
    WaistGirth, "waist_girth", "level, at the natural waist: between the navel and the middle of lowest rib and hip bone, where bodies with this crotch height have it", [Waist];
    HipGirth, "hip_girth", "level, over the seat: midway between its rearmost point and where bodies with this crotch height have it", [Hip];
    ThighGirth, "thigh_girth", "level, below the fold of the seat, 3.4 % of the stature below the crotch", [LeftThigh, RightThigh];
    KneeGirth, "knee_girth", "level, over the knee joint", [LeftKnee, RightKnee];
    CalfGirth, "calf_girth", "level, where the lower leg is thickest", [LeftCalf, RightCalf];
    AnkleGirth, "ankle_girth", "level, where the lower leg is thinnest above the ankle joint", [LeftAnkle, RightAnkle];
    UpperArmGirth, "upper_arm_girth", "across the arm, 55 % of the way from shoulder to elbow joint", [LeftUpperArm, RightUpperArm];
    WristGirth, "wrist_girth", "across the forearm, where it is thinnest right above the wrist joint", [LeftWrist, RightWrist];
    ShoulderWidth, "shoulder_width", "from acromion over the nape to acromion, along the back", [];
    ArmLength, "arm_length", "from the shoulder joint over the elbow to the wrist joint", [];
    BackLength, "back_length", "from the nape to the waist, straight over the hollow of the back", [];
    CrotchHeight, "crotch_height", "floor to where the legs part; if thighs touch, 4.2 % of the stature below the hip joints", [];
    BustHeight, "bust_height", "floor to the tape of the bust", [];
    WaistHeight, "waist_height", "floor to the tape of the waist", [];
    HipHeight, "hip_height", "floor to the tape of the hip", [];
    UnderbustGirth, "underbust_girth", "level, in the fold below the breast, or where it usually is on chests without one", [Underbust];
    HeadGirth, "head_girth", "level, where the head is largest above the ears, over hair and all", [Head];
    FootLength, "foot_length", "heel to the longest toe, along the foot", [];
    Rise, "rise", "from the waist in front between the legs to the waist behind, a taut tape in the mid plane", [];
    NapeToWaist, "nape_to_waist", "from the nape down the middle of the back to the waist, along the skin", [];
    ShoulderToWrist, "shoulder_to_wrist", "from the acromion over the elbow joint to the outer side of the wrist", [];
}

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
    Overbust,
    NarrowestWaist,
    HighHip,
    LeftMidThigh,
    RightMidThigh,
    LeftLowerKnee,
    RightLowerKnee,
    LeftElbow,
    RightElbow,
    LeftForearm,
    RightForearm,
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
    /// Where the neck meets the shoulder, straight beside its joint, 25 degrees upward
    LeftSideNeck,
    RightSideNeck,
    /// Front at the natural waist, straight below the bust point
    LeftWaistFront,
    RightWaistFront,
}

/// What determines the place of a measure
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basis {
    /// The shape of the skin alone
    Skin,
    /// The joints of the fitted skeleton
    Joints,
    /// The shape of the skin, and where people of a survey have it
    SkinAndSurvey,
}

/// One row per measure: variant, key, German name, definition, tapes (left limb first)
macro_rules! measures {
    ($($variant:ident, $key:literal, $german:literal, $definition:literal, [$($girth:ident),*];)*) => {
        /// A measure; girths are tape lengths, the perimeter of the section's convex hull
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Measure {
            $(#[doc = $definition] $variant,)*
        }

        impl Measure {
            /// All measures, in the order of files
            pub const ALL: [Measure; 49] = [$(Measure::$variant,)*];

            /// Returns the key used in files, in snake case
            pub fn name(self) -> &'static str {
                match self {
                    $(Measure::$variant => $key,)*
                }
            }

            /// Returns the German name
            pub fn german_name(self) -> &'static str {
                match self {
                    $(Measure::$variant => $german,)*
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
    Stature, "stature", "Körperhöhe", "height of the person, floor to crown", [];
    NeckGirth, "neck_girth", "Halsumfang", "shortest tape around the neck in a plane whose front is lower by 5 degrees", [Neck];
    BustGirth, "bust_girth", "Brustumfang", "level, below the armpits, over the most forward points of the chest beside the breast bone", [Bust];
    WaistGirth, "waist_girth", "Taillenumfang", "level, at the natural waist: between the navel and the middle of lowest rib and hip bone, where bodies with this crotch height have it", [Waist];
    HipGirth, "hip_girth", "Hüftumfang", "level, over the seat: midway between its rearmost point and where bodies with this crotch height have it", [Hip];
    ThighGirth, "thigh_girth", "Oberschenkelumfang", "level, below the fold of the seat, 3.4 % of the stature below the crotch", [LeftThigh, RightThigh];
    KneeGirth, "knee_girth", "Knieumfang", "level, over the knee joint", [LeftKnee, RightKnee];
    CalfGirth, "calf_girth", "Wadenumfang", "level, where the lower leg is thickest", [LeftCalf, RightCalf];
    AnkleGirth, "ankle_girth", "Fesselumfang", "level, where the lower leg is thinnest above the ankle joint", [LeftAnkle, RightAnkle];
    UpperArmGirth, "upper_arm_girth", "Oberarmumfang", "across the arm, 55 % of the way from shoulder to elbow joint", [LeftUpperArm, RightUpperArm];
    WristGirth, "wrist_girth", "Handgelenkumfang", "across the forearm, where it is thinnest right above the wrist joint", [LeftWrist, RightWrist];
    ShoulderWidth, "shoulder_width", "Schulterbreite", "from acromion over the nape to acromion, along the back", [];
    ArmLength, "arm_length", "Armlänge von Gelenk zu Gelenk", "from the shoulder joint over the elbow to the wrist joint", [];
    BackLength, "back_length", "Rückenlänge, gespannt", "from the nape to the waist, straight over the hollow of the back", [];
    CrotchHeight, "crotch_height", "Schritthöhe", "floor to where the legs part; if thighs touch, 4.2 % of the stature below the hip joints", [];
    BustHeight, "bust_height", "Brusthöhe", "floor to the tape of the bust", [];
    WaistHeight, "waist_height", "Taillenhöhe", "floor to the tape of the waist", [];
    HipHeight, "hip_height", "Hüfthöhe", "floor to the tape of the hip", [];
    UnderbustGirth, "underbust_girth", "Unterbrustumfang", "level, below the breast: near its fold and where it usually is, where a taut tape does not slip", [Underbust];
    HeadGirth, "head_girth", "Kopfumfang", "level, where the head is largest above the ears, over hair and all", [Head];
    FootLength, "foot_length", "Fußlänge", "heel to the longest toe, along the foot", [];
    Rise, "rise", "Schrittlänge", "from the waist in front between the legs to the waist behind, a taut tape in the mid plane", [];
    NapeToWaist, "nape_to_waist", "Rückenlänge", "from the nape down the middle of the back to the waist, along the skin", [];
    ShoulderToWrist, "shoulder_to_wrist", "Armlänge", "from the acromion over the elbow joint to the outer side of the wrist", [];
    OverbustGirth, "overbust_girth", "Oberbrustumfang", "level, directly below the armpits, above the bust", [Overbust];
    NarrowestWaistGirth, "narrowest_waist_girth", "Umfang der schmalsten Taille", "level, where the trunk is thinnest between ribs and hips; not on bodies without such a place", [NarrowestWaist];
    HighHipGirth, "high_hip_girth", "Hochhüftumfang", "level, midway between the tapes of waist and hip", [HighHip];
    MidThighGirth, "mid_thigh_girth", "Umfang in der Mitte des Oberschenkels", "level, midway between crotch and knee joint", [LeftMidThigh, RightMidThigh];
    LowerKneeGirth, "lower_knee_girth", "Umfang unterhalb des Knies", "level, where the leg is thinnest between knee joint and calf", [LeftLowerKnee, RightLowerKnee];
    ElbowGirth, "elbow_girth", "Ellenbogenumfang", "across the stretched arm, over the elbow joint", [LeftElbow, RightElbow];
    ForearmGirth, "forearm_girth", "Unterarmumfang", "across the forearm, where it is thickest below the elbow", [LeftForearm, RightForearm];
    NapeHeight, "nape_height", "Höhe des Halswirbels", "floor to the seventh cervical vertebra, the nape", [];
    ShoulderHeight, "shoulder_height", "Schulterhöhe", "floor to the acromion", [];
    UnderbustHeight, "underbust_height", "Unterbrusthöhe", "floor to the tape below the breast", [];
    KneeHeight, "knee_height", "Kniehöhe", "floor to the knee joint", [];
    ShoulderLength, "shoulder_length", "Schulterlänge", "from the side of the neck to the acromion, a taut tape", [];
    UpperArmLength, "upper_arm_length", "Oberarmlänge", "from the acromion to the elbow joint", [];
    NapeToWrist, "nape_to_wrist", "Armlänge ab Halswirbel", "from the nape over acromion and elbow joint to the outer side of the wrist", [];
    AcrossBack, "across_back", "Rückenbreite", "level, over the back from arm to arm, midway between acromion and armpit, a taut tape", [];
    AcrossFront, "across_front", "Brustbreite", "level, over the chest from arm to arm, midway between acromion and armpit, a taut tape", [];
    BustSpan, "bust_span", "Brustpunktabstand", "from bust point to bust point, straight", [];
    SideNeckToBust, "side_neck_to_bust", "Brusttiefe", "from the side of the neck to the bust point, a taut tape", [];
    FrontLength, "front_length", "Vordere Länge", "from the side of the neck over the bust point straight down to the waist, a taut tape", [];
    WaistToHip, "waist_to_hip", "Hüfttiefe", "vertical distance of the tapes of waist and hip", [];
    BodyRise, "body_rise", "Leibhöhe", "vertical distance of waist and crotch", [];
    WaistToKnee, "waist_to_knee", "Taille bis Knie", "vertical distance of waist and knee joint", [];
    FrontRise, "front_rise", "Vordere Schrittlänge", "the part of the rise from the waist in front to straight below the hip joints", [];
    BackRise, "back_rise", "Hintere Schrittlänge", "the part of the rise from straight below the hip joints to the waist behind", [];
    NarrowestWaistHeight, "narrowest_waist_height", "Höhe der schmalsten Taille", "floor to the tape of the narrowest waist", [];
}

impl Measure {
    /// Returns what determines the place of the measure on the body
    pub fn basis(self) -> Basis {
        match self {
            Measure::WaistGirth
            | Measure::WaistHeight
            | Measure::HipGirth
            | Measure::HipHeight
            | Measure::HighHipGirth
            | Measure::UnderbustGirth
            | Measure::UnderbustHeight
            | Measure::BackLength
            | Measure::NapeToWaist
            | Measure::Rise
            | Measure::FrontRise
            | Measure::BackRise
            | Measure::FrontLength
            | Measure::WaistToHip
            | Measure::BodyRise
            | Measure::WaistToKnee => Basis::SkinAndSurvey,
            Measure::KneeGirth
            | Measure::KneeHeight
            | Measure::MidThighGirth
            | Measure::UpperArmGirth
            | Measure::ElbowGirth
            | Measure::ArmLength
            | Measure::ShoulderWidth
            | Measure::ShoulderHeight
            | Measure::ShoulderLength
            | Measure::ShoulderToWrist
            | Measure::UpperArmLength
            | Measure::NapeHeight
            | Measure::NapeToWrist
            | Measure::AcrossBack
            | Measure::AcrossFront
            | Measure::SideNeckToBust => Basis::Joints,
            Measure::Stature
            | Measure::NeckGirth
            | Measure::BustGirth
            | Measure::OverbustGirth
            | Measure::BustHeight
            | Measure::BustSpan
            | Measure::ThighGirth
            | Measure::CalfGirth
            | Measure::LowerKneeGirth
            | Measure::AnkleGirth
            | Measure::WristGirth
            | Measure::ForearmGirth
            | Measure::CrotchHeight
            | Measure::HeadGirth
            | Measure::FootLength
            | Measure::NarrowestWaistGirth
            | Measure::NarrowestWaistHeight => Basis::Skin,
        }
    }

    /// Returns whether a tape of cloth would compress the tissue below it: these girths are measured without contact, and
    /// are larger than those by hand
    pub fn is_on_soft_tissue(self) -> bool {
        let bony = matches!(
            self,
            Measure::HeadGirth
                | Measure::KneeGirth
                | Measure::AnkleGirth
                | Measure::ElbowGirth
                | Measure::WristGirth
        );
        !self.girths().is_empty() && !bony
    }
}

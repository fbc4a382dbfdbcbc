//! Tape measurements of a body.

use serde::Serialize;

/// A girth, by the key that files use; of the left and right limb where there are two, both have a loop
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum Girth {
    Neck,
    Bust,
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[allow(missing_docs, reason = "the names say it")]
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

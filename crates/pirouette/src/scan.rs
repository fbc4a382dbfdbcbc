//! A scan: all views of one person turning before one static camera.

use pirouette_geom::{Grid, Mask, TriMesh};

use pirouette_body::{Keypoints, ReferencePose, Sex, TurnAngle};
use pirouette_segment::seeds::LogOdds;

/// RGB pixels as given, after applying the EXIF orientation
pub type Photo = Grid<[u8; 3]>;

/// All views of one person
#[derive(Debug, Clone)]
pub struct Scan {
    /// The pose the person tries to hold
    pub pose: ReferencePose,
    /// Height of the person as photographed, from the floor to the crown, the soles of their shoes included, in mm
    pub stature_mm: Option<f64>,
    /// Source of that height
    pub stature_from: StatureFrom,
    /// Size of a pixel of the photos as given, at the turning axis, in mm
    pub mm_per_px: Option<f64>,
    /// Additional data given by the person
    pub subject: Subject,
    /// Known camera parameters
    pub camera: CameraSetup,
    /// The usable views, in the order of the manifest or of the file names
    pub views: Vec<View>,
    /// The scene without the person, if a picture of it is given
    pub background: Option<Background>,
    /// Number of given views that cannot be used, and are not in `views`
    pub unusable_view_count: usize,
    /// The surface of the person at turn 0, world frame, mm, if the views are those of a known mesh
    pub surface: Option<TriMesh>,
}

impl Scan {
    /// Returns the height of the person without the soles of their shoes, in mm
    pub fn barefoot_mm(&self) -> Option<f64> {
        let sole_mm = self.subject.sole_mm.unwrap_or(0.0);
        self.stature_mm.map(|stature_mm| stature_mm - sole_mm)
    }

    /// Returns the number of given views, including unusable ones
    pub fn given_view_count(&self) -> usize {
        self.views.len() + self.unusable_view_count
    }

    /// Returns whether all photos have nearly the same ratio of width to height
    pub fn has_one_shape(&self) -> bool {
        let mut shapes = self.views.iter().map(|view| {
            let (width, height) = (view.photo.width(), view.photo.height());
            width as f64 / height as f64
        });
        let first = shapes.next();
        first.is_none_or(|first| shapes.all(|shape| (shape / first - 1.0).abs() < 0.02))
    }
}

/// The scene without the person, as the camera of the views sees it
#[derive(Debug, Clone, PartialEq)]
pub struct Background {
    /// Its picture, in the size of the views
    pub photo: Photo,
    /// Where the picture shows the scene; elsewhere it is unknown
    pub known: Mask,
}

/// Source of the person's height, which sets the scale of all lengths
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StatureFrom {
    /// Given by the person
    #[default]
    Stated,
    /// From a card of known size in a photo
    Card,
    /// From the size of a pixel at the turning axis
    PixelSize,
    /// The height of a mesh
    Mesh,
}

/// Data about the body given by a person; survey statistics then contribute to the measurements, marked as such
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Subject {
    /// Sex
    pub sex: Option<Sex>,
    /// Body mass, in kg
    pub mass_kg: Option<f64>,
    /// Age, in years
    pub age_years: Option<f64>,
    /// Standard deviation of the stated stature, in mm; if `None`, that of statures as people remember them
    pub stature_sd_mm: Option<f64>,
    /// Clothes that the person wears
    pub clothes: Option<StatedClothes>,
    /// Thickness of the soles below the heels, in mm; 0 is barefoot
    pub sole_mm: Option<f64>,
}

/// How loosely a part is covered
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Looseness {
    /// Bare, or in clothes that lie on the skin
    Tight,
    /// In clothes with the usual ease: shirts, trousers
    Normal,
    /// In clothes that hang, skirts, hair, shoes
    Loose,
}

impl Looseness {
    /// All kinds, in the order of their discriminants
    pub const ALL: [Looseness; 3] = [Looseness::Tight, Looseness::Normal, Looseness::Loose];

    /// Returns the name used in files
    pub fn name(self) -> &'static str {
        match self {
            Looseness::Tight => "tight",
            Looseness::Normal => "normal",
            Looseness::Loose => "loose",
        }
    }

    /// Returns the looseness of a name
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// Clothes that a person states to wear
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct StatedClothes {
    /// On trunk and upper arms
    pub top: Looseness,
    /// On hips and legs
    pub bottom: Looseness,
}

impl StatedClothes {
    /// Returns one looseness for all clothes
    pub fn all(looseness: Looseness) -> Self {
        Self {
            top: looseness,
            bottom: looseness,
        }
    }

    /// Returns whether all clothes are tight
    pub fn is_tight(self) -> bool {
        self == Self::all(Looseness::Tight)
    }
}

/// Known camera parameters; the others are estimated
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraSetup {
    /// Vertical field of view, from the manifest or else from EXIF
    pub vertical_fov_radians: Option<f64>,
    /// Height above the floor, in mm
    pub height_mm: Option<f64>,
    /// Distance from the turning axis, in mm
    pub distance_mm: Option<f64>,
    /// Pitch; positive looks down
    pub pitch_radians: Option<f64>,
    /// Yaw; positive looks to the right of the turning axis
    pub yaw_radians: Option<f64>,
    /// Radial distortion of the lens, the coefficient of [`pirouette_body::lens::Lens`]; found in the photos by
    /// [`crate::check::check_scan`]
    pub distortion: f64,
}

/// Origin of the keypoints of a view
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum KeypointSource {
    /// A file, by any detector
    #[default]
    Given,
    /// Detected in the photo: see [`crate::detect`]
    BlazePose,
    /// Estimated from all photos without a detector: see [`crate::estimate`]
    Estimate,
}

/// Definition of the joints that a detector was trained on
///
/// Detectors place hips, shoulders and feet differently: each definition has its own offsets from the joints of the
/// skeleton, and its own errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum KeypointKind {
    /// OpenPose's models: COCO's points, retrained with neck and feet
    #[default]
    OpenPose,
    /// MediaPipe's 33 landmarks (BlazePose)
    MediaPipe,
    /// COCO's 17 points as annotated, and the data sets that extend them (COCO-WholeBody, Halpe)
    Coco,
}

/// Standard deviation of a person's turn around a stated angle if none is given, in degrees
pub const STATED_TURN_SD_DEGREES: f64 = 5.0;

/// One photo of the person with what was detected in it
#[derive(Debug, Clone)]
pub struct View {
    /// Stem of the photo's file name
    pub name: String,
    /// The photo, downscaled when the input was larger than the method needs
    pub photo: Photo,
    /// Columns and rows of the input; masks are written in this size
    pub input_size_px: (usize, usize),
    /// Turn angle of the person as stated; of no meaning if unknown
    pub turn: TurnAngle,
    /// Prior standard deviation of the person's turn around that angle, sway included; infinite if the angle is unknown
    pub turn_sd_radians: f64,
    /// Time stamp in the video that the photo was taken from, in s
    pub time_s: Option<f64>,
    /// Detected joints, in px of the photo
    pub keypoints: Keypoints,
    /// Origin of the keypoints
    pub keypoints_from: KeypointSource,
    /// Definition of the joints by their detector
    pub keypoint_kind: KeypointKind,
    /// A given silhouette, size of `photo`; replaces segmentation
    pub mask: Option<Mask>,
    /// Log odds of each pixel of `photo` to show the person, by a detector; supports the segmentation of single photos
    pub person_odds: Option<Grid<LogOdds>>,
}

impl View {
    /// Returns whether the turn angle is stated
    pub fn turn_is_stated(&self) -> bool {
        self.turn_sd_radians.is_finite()
    }

    /// Returns whether a fitted body has more accurate joints: if the keypoints are estimates, or those of a fast detector
    pub fn keypoints_are_rough(&self) -> bool {
        self.keypoints_from == KeypointSource::Estimate
            || self.keypoint_kind == KeypointKind::MediaPipe
    }
}

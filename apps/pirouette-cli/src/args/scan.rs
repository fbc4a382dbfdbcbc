//! Arguments of `scan` and of the commands that run only a part of its stages.

use std::convert::Infallible;
use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use pirouette::measure;
use pirouette::mesh_scan::{AxisDirection, MeshUnit};
use pirouette::scan;
use pirouette_files::formats::export::ExportFormat;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::{job, results};

use super::Sex;

/// Arguments of `scan`, `segment`, `normalize`, `reconstruct` and `measure`
#[derive(Debug, Args)]
pub struct ScanArgs {
    /// Folder of photos, with optional keypoint files and scan.json, or a zip file of it; or a video, with scan.json in
    /// its folder
    #[arg(value_name = "SCAN")]
    pub scan: PathBuf,

    /// Result folder; an earlier result in it is replaced, or removed if the scan fails; other files are kept
    #[arg(short, long, value_name = "OUT", default_value = "out")]
    pub out: PathBuf,

    /// Keypoints of the photos instead of those in SCAN: one file for all photos, or a folder with a file per photo;
    /// `none` ignores keypoint files and the detector, and estimates the joints from the photos and the turn angles
    #[arg(long, value_name = "FILE_OR_DIR|none")]
    pub keypoints: Option<KeypointInput>,

    /// Network of the pose detector, for photos without a keypoint file [default: the installed one]
    #[arg(long, value_name = "FILE")]
    pub pose_model: Option<PathBuf>,

    /// Number of views taken from a video, spread over one turn
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(4..=72))]
    pub views: u16,

    /// `unknown` finds the turn angles in the photos, in any order and direction, instead of using those stated
    #[arg(long, value_name = "SOURCE", value_enum)]
    pub angles: Option<Angles>,

    #[command(flatten)]
    pub method: MethodArgs,

    /// Mesh formats of the body
    #[arg(
        long,
        value_name = "FORMATS",
        value_delimiter = ',',
        default_value = "ply"
    )]
    pub format: Vec<Format>,

    /// Pose of the body: `reference` has the arms of the mannequin and the trunk and legs of the photos; `photographed` is
    /// that of the front view; `a` and `t` have straight arms
    #[arg(long, value_enum, value_name = "POSE", default_value_t = BodyPose::Reference)]
    pub body_pose: BodyPose,

    /// Also write report.html: all results on one self-contained page
    #[arg(long)]
    pub report: bool,

    /// Also write the measurements in formats of other programs
    #[arg(long, value_name = "NAMES", value_enum, value_delimiter = ',')]
    pub export: Vec<Export>,

    /// Source of the scale when scan.json has neither `stature_mm` nor `mm_per_px`: `card` detects an ID-1 card (bank
    /// card, 85.60 x 53.98 mm) beside the person
    #[arg(long, value_name = "SOURCE", value_enum)]
    pub scale: Option<ScaleSource>,

    /// Size charts to use instead of the built-in ones; see `size --help`
    #[arg(long, value_name = "FILE.toml")]
    pub chart: Option<PathBuf>,
}

/// Arguments of `measure`
#[derive(Debug, Args)]
pub struct MeasureArgs {
    #[command(flatten)]
    pub scan: ScanArgs,

    /// Unit of the mesh [default: the one in which a person has its height]
    #[arg(long, value_enum, value_name = "UNIT")]
    pub unit: Option<Unit>,

    /// Axis of the mesh that points up [default: found by trunk and legs]
    #[arg(long, value_enum, value_name = "AXIS", allow_hyphen_values = true)]
    pub up: Option<Axis>,

    /// Axis of the mesh that points to the front of the person [default: found by the feet]
    #[arg(long, value_enum, value_name = "AXIS", allow_hyphen_values = true)]
    pub front: Option<Axis>,

    /// Sex of the person in the mesh, for size charts
    #[arg(long, value_enum)]
    pub sex: Option<Sex>,
}

/// Unit of a mesh
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Unit {
    Mm,
    Cm,
    M,
    #[value(name = "in")]
    Inch,
}

impl Unit {
    /// Returns the corresponding unit of the library
    pub fn of_mesh(self) -> MeshUnit {
        match self {
            Unit::Mm => MeshUnit::Millimeter,
            Unit::Cm => MeshUnit::Centimeter,
            Unit::M => MeshUnit::Meter,
            Unit::Inch => MeshUnit::Inch,
        }
    }
}

/// Direction of an axis of a mesh
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Axis {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    NegX,
    #[value(name = "-y")]
    NegY,
    #[value(name = "-z")]
    NegZ,
}

impl Axis {
    /// Returns the corresponding direction of the library
    pub fn of_mesh(self) -> AxisDirection {
        match self {
            Axis::X => AxisDirection::X,
            Axis::Y => AxisDirection::Y,
            Axis::Z => AxisDirection::Z,
            Axis::NegX => AxisDirection::NegX,
            Axis::NegY => AxisDirection::NegY,
            Axis::NegZ => AxisDirection::NegZ,
        }
    }
}

/// Value of `--body-pose`
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BodyPose {
    Reference,
    Photographed,
    A,
    T,
}

impl BodyPose {
    /// Returns the corresponding value of the library
    pub fn of_results(self) -> results::BodyPose {
        match self {
            BodyPose::Reference => results::BodyPose::Reference,
            BodyPose::Photographed => results::BodyPose::Photographed,
            BodyPose::A => results::BodyPose::A,
            BodyPose::T => results::BodyPose::T,
        }
    }
}

/// Value of `--keypoints`
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum KeypointInput {
    /// A file for all photos, or a folder with a file per photo
    Files(PathBuf),
    /// Neither files nor the detector
    None,
}

impl FromStr for KeypointInput {
    type Err = Infallible;

    fn from_str(value: &str) -> Result<Self, Self::Err> {
        Ok(match value {
            "none" => KeypointInput::None,
            path => KeypointInput::Files(PathBuf::from(path)),
        })
    }
}

/// Options of the method
#[derive(Debug, Args)]
pub struct MethodArgs {
    /// `fit` fits one body to all views; `three-step` is the published method, which treats each view separately
    #[arg(long, value_enum, default_value_t = Method::Fit)]
    pub method: Method,

    /// Skinned glTF or VRM avatar of human proportions to use as the reference instead of the built-in one
    #[arg(long, value_name = "FILE.glb|.vrm")]
    pub avatar: Option<PathBuf>,

    /// Register each silhouette to that of the reference by a rigid motion [default with three-step]
    #[arg(long, overrides_with = "no_register")]
    pub register: bool,

    /// Skip the registration [default with fit]
    #[arg(long)]
    pub no_register: bool,

    /// Refine arms and legs against the reference [default with three-step]
    #[arg(long, overrides_with = "no_refine")]
    pub refine: bool,

    /// Skip the refinement [default with fit]
    #[arg(long)]
    pub no_refine: bool,

    /// Also carve the visual hull and write it in the formats of the body
    #[arg(long)]
    pub hull: bool,

    /// Clothes that the person wears, instead of those in scan.json: how loosely they hang [default: found by measures that
    /// no body has together]
    #[arg(long, value_name = "LOOSENESS", value_enum)]
    pub clothes: Option<Looseness>,

    /// Surface to measure: `body` is the body below clothes and hair, `clothed` is what the photos show
    #[arg(long, value_enum, default_value_t = Surface::Body)]
    pub surface: Surface,
}

/// Value of `--clothes`
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Looseness {
    Tight,
    Normal,
    Loose,
}

impl Looseness {
    /// Returns the corresponding statement of the library
    pub fn statement(self) -> scan::StatedClothes {
        scan::StatedClothes::all(match self {
            Looseness::Tight => scan::Looseness::Tight,
            Looseness::Normal => scan::Looseness::Normal,
            Looseness::Loose => scan::Looseness::Loose,
        })
    }
}

/// Value of `--surface`
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Surface {
    Body,
    Clothed,
}

impl Surface {
    /// Returns the corresponding value of the library
    pub fn of_config(self) -> measure::Surface {
        match self {
            Surface::Body => measure::Surface::Body,
            Surface::Clothed => measure::Surface::Clothed,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Method {
    Fit,
    ThreeStep,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Angles {
    Unknown,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ScaleSource {
    Card,
}

impl ScaleSource {
    /// Returns the corresponding value of the library
    pub fn of_job(self) -> job::ScaleSource {
        match self {
            ScaleSource::Card => job::ScaleSource::Card,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Export {
    /// measurements.flat.json: value and standard deviation per measure
    Json,
    /// measurements.csv
    Csv,
    /// measurements.schema-org.json
    SchemaOrg,
    /// measurements.freesewing.yaml
    Freesewing,
    /// measurements.vit, for Seamly2D and Valentina
    #[value(alias = "valentina")]
    Seamly2d,
}

impl Export {
    /// Returns the corresponding format of the library
    pub fn of_file(self) -> ExportFormat {
        match self {
            Export::Json => ExportFormat::Json,
            Export::Csv => ExportFormat::Csv,
            Export::SchemaOrg => ExportFormat::SchemaOrg,
            Export::Freesewing => ExportFormat::FreeSewing,
            Export::Seamly2d => ExportFormat::Seamly2d,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    Ply,
    Glb,
    Obj,
    Stl,
    Off,
}

impl Format {
    /// Returns the corresponding format of the library
    pub fn of_mesh(self) -> MeshFormat {
        match self {
            Format::Ply => MeshFormat::Ply,
            Format::Glb => MeshFormat::Glb,
            Format::Obj => MeshFormat::Obj,
            Format::Stl => MeshFormat::Stl,
            Format::Off => MeshFormat::Off,
        }
    }
}

pub const SCAN_HELP: &str = "\
A scan folder contains photos of a person who turns to the left in equal steps in front of a static camera:
  000.jpg 001.jpg ...
The pose detector (see `pirouette models`) finds the joints in each photo that has no keypoint file. Keypoint files of
OpenPose, COCO, MMPose, AlphaPose, Halpe, MediaPipe and YOLO pose models are recognized by their content:
  000_keypoints.json or 000.json next to the photo 000.jpg or in keypoints/, keypoints/000.txt, labels/000.txt,
  keypoints.json or alphapose-results.json for all photos, by their names or numbers
If there is neither a file nor a detector, the joints are estimated from at least four photos, or with a photo of the empty
room: background.jpg, or \"background\" in scan.json.
An optional scan.json provides additional data, most importantly the person's height. All keys except `image` are
optional; without `views`, the photos are used in the order of their names:
  { \"pose\": \"a\", \"subject\": { \"stature_mm\": 1748, \"sex\": \"female\", \"mass_kg\": 64, \"age_years\": 35 },
    \"camera\": { \"vertical_fov_deg\": 50.1, \"height_mm\": 890, \"distance_mm\": 2400, \"pitch_deg\": 0,
                \"mm_per_px\": 2.1 },
    \"views\": [ { \"image\": \"000.jpg\", \"keypoints\": \"000_keypoints.json\", \"angle_deg\": 0,
                 \"mask\": \"000_mask.png\" } ] }

A stature is assumed to be as people state it, with a standard deviation of 12 mm; if it was measured, say so by
\"stature_sd_mm\": 5 beside it, which reduces the standard deviations of all measures.

Tight clothes are best. Others are recognized by girths that no body has with the rest, for example at hems, or stated:
\"clothes\": \"tight\", \"normal\", \"loose\", or { \"top\": \"loose\", \"bottom\": \"tight\" } in `subject`, or --clothes. Measures
of covered parts are then those of the body below, as far as stature, mass and everything that is seen determine them by the
covariances of a survey, with standard deviations of 20 to 60 mm; the same holds for a neck or a head below hair.
--surface clothed measures clothes and hair instead. The stature is that of the barefoot person; in shoes, give the thickness of
the soles below the heels, \"sole_mm\": 25, beside it: heights are then those above the soles.

Turn angles that are unknown are `\"angle_deg\": null`, or `--angles unknown` for all: they are found by the joints of at least
four photos, and turn 0 is where the person faces the camera, or as the stated angles have it. Stated angles are a prior: their
standard deviation is `\"angle_sd_deg\": 5`, beside `views`; clearly wrong ones are reported and replaced by those found.

A video of one turn is decoded by the program ffmpeg; scan.json is in its folder, or NAME.json beside NAME.mp4. The pose
detector finds the turn, and --views sharp frames become views with their times. Photos taken from a video elsewhere may have
\"time_s\" beside \"angle_deg\".

The file may be UTF-8 or UTF-16, with comments, trailing commas and decimal commas. A mask is white on black in the size of
the photo; inverted masks, cut-outs, one color per person and other sizes are recognized.

Without the height, the scale is computed from the size of a pixel at the turning axis (`mm_per_px`) or from a bank
card in a photo (`--scale card`); without any of these, lengths are in units of the height. Given sex and mass, survey
statistics contribute to the measurements; `details` lists both contributions. The survey is of adults: it is not used
below an age of 17 years or a stature of 1400 mm.

Examples:
  pirouette scan photos/anna
  pirouette scan anna.zip -o anna
  pirouette scan photos/anna --keypoints alphapose-results.json
  pirouette scan photos/anna --keypoints none
  pirouette scan photos/anna --angles unknown
  pirouette scan photos/anna --scale card --export csv,seamly2d
  pirouette scan photos/anna -o anna --format ply,glb --report
  pirouette scan photos/anna --method three-step --no-refine
  pirouette scan photos/anna --avatar me.vrm --json | jq .measurements_mm";

pub const SEGMENT_HELP: &str = "\
Writes result.json, contact.jpg and, for each view, mask.png, overlay.jpg and view.json.

Examples:
  pirouette segment photos/anna -o anna
  pirouette segment one_photo -o out       a folder with one photo and its keypoints";

pub const NORMALIZE_HELP: &str = "\
In addition to `segment`, writes normalized.png for each view and, with the method `fit`, residuals.jpg.

Examples:
  pirouette normalize photos/anna -o anna
  pirouette normalize photos/anna --method three-step --no-register --no-refine";

pub const RECONSTRUCT_HELP: &str = "\
In addition to `normalize`, writes the body.

Examples:
  pirouette reconstruct photos/anna -o anna --format obj,stl";

pub const MEASURE_HELP: &str = "\
With photos, same as `scan`. With a mesh (.ply, .obj, .stl, .off, .glb) of a person in A-pose, T-pose or with hanging arms, as
of booths, phones with depth sensors and body models, a mannequin is fitted to its surface, which finds the places of the
tapes; the results are those of a scan, its pictures show the mesh. The mesh may have holes and loose parts. It is measured
as it is: hair counts to the stature, and clothes to the girths.

Examples:
  pirouette measure photos/anna -o anna
  pirouette measure anna.obj -o anna --report
  pirouette measure booth.ply --unit cm --up z --front -y
  pirouette measure photos/anna --json --quiet";

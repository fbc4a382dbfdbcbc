//! Arguments of `scan` and of the commands that stop after one of its stages.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use pirouette_files::formats::export::ExportFormat;
use pirouette_files::formats::mesh::MeshFormat;
use pirouette_files::job;

/// Arguments of the main job and its stages
#[derive(Debug, Args)]
pub struct ScanArgs {
    /// Folder of photos with keypoint files, perhaps a scan.json, or a zip file of it
    #[arg(value_name = "SCAN")]
    pub scan: PathBuf,

    /// Result folder; an existing one is replaced file by file, never emptied
    #[arg(short, long, value_name = "OUT", default_value = "out")]
    pub out: PathBuf,

    #[command(flatten)]
    pub method: MethodArgs,

    /// Formats of the body, where one is carved
    #[arg(
        long,
        value_name = "FORMATS",
        value_delimiter = ',',
        default_value = "ply"
    )]
    pub format: Vec<Format>,

    /// Write report.html too: all results on one page that needs no other file
    #[arg(long)]
    pub report: bool,

    /// Write the measurements for other programs, too
    #[arg(long, value_name = "NAMES", value_enum, value_delimiter = ',')]
    pub export: Vec<Export>,

    /// Where the scale comes from when scan.json tells neither `stature_mm` nor `mm_per_px`: `card` looks for an ID-1 card
    /// (85.60 x 53.98 mm, as bank cards) beside the person
    #[arg(long, value_name = "SOURCE", value_enum)]
    pub scale: Option<ScaleSource>,

    /// Size charts to use instead of the built-in ones; see `size --help`
    #[arg(long, value_name = "FILE.toml")]
    pub chart: Option<PathBuf>,
}

/// How the job is done
#[derive(Debug, Args)]
pub struct MethodArgs {
    /// `fit` explains all views by one body; `three-step` is the published method, view by view
    #[arg(long, value_enum, default_value_t = Method::Fit)]
    pub method: Method,

    /// Skinned glTF or VRM figure to use as the reference instead of the built-in one
    #[arg(long, value_name = "FILE.glb|.vrm")]
    pub avatar: Option<PathBuf>,

    /// Fit each view's silhouette to that of the reference by a rigid motion [default with three-step]
    #[arg(long, overrides_with = "no_register")]
    pub register: bool,

    /// Leave the registration out [default with fit]
    #[arg(long)]
    pub no_register: bool,

    /// Refine arms and legs against the reference [default with three-step]
    #[arg(long, overrides_with = "no_refine")]
    pub refine: bool,

    /// Leave the refinement out [default with fit]
    #[arg(long)]
    pub no_refine: bool,

    /// Carve the visual hull, too, and write it beside the fitted body, in the same formats
    #[arg(long)]
    pub hull: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Method {
    Fit,
    ThreeStep,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ScaleSource {
    Card,
}

impl ScaleSource {
    /// The library's source
    pub fn of_job(self) -> job::ScaleSource {
        match self {
            ScaleSource::Card => job::ScaleSource::Card,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Export {
    /// measurements.flat.json: value and deviation per measure
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
    /// The library's format
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
    /// The library's format
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
A scan folder holds photos of a person who turns to the left in even steps before a camera that does not
move, and beside each photo its keypoints (OpenPose JSON, BODY_25):
  000.jpg 000_keypoints.json 001.jpg 001_keypoints.json ...
An optional scan.json tells more, most of all the person's height; every key but `image` may be left out,
and without `views` the photos are taken in the order of their names:
  { \"pose\": \"a\", \"subject\": { \"stature_mm\": 1748, \"sex\": \"female\", \"mass_kg\": 64, \"age_years\": 35 },
    \"camera\": { \"vertical_fov_deg\": 50.1, \"height_mm\": 890, \"distance_mm\": 2400, \"pitch_deg\": 0,
                \"mm_per_px\": 2.1 },
    \"views\": [ { \"image\": \"000.jpg\", \"keypoints\": \"000_keypoints.json\", \"angle_deg\": 0,
                 \"mask\": \"000_mask.png\" } ] }

Without the height, the scale may come from the size of a pixel at the turning axis (`mm_per_px`) or from a bank card in a
photo (`--scale card`); without any, lengths are in units of the height. With sex and mass, statistics of a survey support
the measures: details tell what came from pixels and what from them. The age is only written down with the results.

Examples:
  pirouette scan photos/anna
  pirouette scan anna.zip -o anna
  pirouette scan photos/anna --scale card --export csv,seamly2d
  pirouette scan photos/anna -o anna --format ply,glb --report
  pirouette scan photos/anna --method three-step --no-refine
  pirouette scan photos/anna --avatar me.vrm --json | jq .measurements_mm";

pub const SEGMENT_HELP: &str = "\
Writes result.json, contact.jpg and, per view, mask.png, overlay.jpg and view.json.

Examples:
  pirouette segment photos/anna -o anna
  pirouette segment one_photo -o out       a folder with one photo and its keypoints";

pub const NORMALIZE_HELP: &str = "\
Does what `segment` does, and writes normalized.png per view and, with the method `fit`, residuals.jpg.

Examples:
  pirouette normalize photos/anna -o anna
  pirouette normalize photos/anna --method three-step --no-register --no-refine";

pub const RECONSTRUCT_HELP: &str = "\
Does what `normalize` does, and writes the body.

Examples:
  pirouette reconstruct photos/anna -o anna --format obj,stl";

pub const MEASURE_HELP: &str = "\
Does what `reconstruct` does, and writes measurements.json.

Examples:
  pirouette measure photos/anna -o anna
  pirouette measure photos/anna --json --quiet";

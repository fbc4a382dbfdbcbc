//! From photos of a person turning on the spot to pose-normalized silhouettes, a 3D body and tape measurements.
//!
//! This crate is the method: pure computation over data in memory, without files, and without threads if the feature
//! `parallel` is disabled. The crate `pirouette-files` reads scans from folders, zip files and memory, and writes results
//! in standard formats.
//!
//! # Example
//!
//! Scans a rendered person and prints a girth. Real scans come from `pirouette_files::job`.
//!
//! ```
//! use pirouette::measure::Measure;
//! use pirouette::pipeline::{CancelToken, Config, Goal, Method, PipelineError, run};
//! use pirouette_synthetic::people::turning_woman;
//!
//! let person = turning_woman(4); // four photos with keypoints, 90 degrees apart
//! let config = Config::new(Goal::Measure, Method::Fit);
//! let report = run(&person.scan, &config, &CancelToken::default(), &mut |_| {})?;
//!
//! let measurements = report.measurements.expect("the goal is to measure");
//! let waist = measurements.get(Measure::WaistGirth);
//! println!("waist: {:.0?} mm, standard deviation {:.0?} mm", waist.value_mm, waist.sd_mm);
//! # let waist_mm = waist.value_mm.as_ref().unwrap();
//! # assert!((600.0..1000.0).contains(waist_mm), "{waist_mm}");
//! # Ok::<(), PipelineError>(())
//! ```
//!
//! # Terms
//!
//! - A [scan](scan::Scan) is a set of views of one person by a static camera.
//! - A [view](scan::View) is one photo with keypoints (BODY_25) and the *turn angle* of the person: 0 when facing the
//!   camera, increasing counter-clockwise seen from above.
//! - An [avatar](body::Avatar) is a closed skinned surface in its *reference pose* (A or T): the built-in mannequin, a
//!   glTF file, or the fitted body of the person.
//! - A *silhouette* is the mask of the person in a photo. It is *normalized* when it is deformed to the reference pose,
//!   as if the person had not moved between the photos.
//! - The *stature* is the height of the person. Without it, lengths are in units of the stature.
//!
//! # Frames and units
//!
//! All lengths are in millimeters unless the name says otherwise (`_px`, `_radians`).
//!
//! | frame | origin and axes |
//! |---|---|
//! | world | fixed to the person: floor below the turning axis; y up, z to the front, x to the person's left |
//! | room | fixed to the camera: same origin, y up, the camera above the z axis; the person is rotated by the turn angle |
//! | view | fixed to the camera: camera center; x right, y down, z forward |
//! | photo | top left corner of the top left pixel; x right, y down, pixel centers at .5 |
//!
//! Transforms name both frames, target first: `room_from_world`, `view_from_room`.
//!
//! # Stages
//!
//! [`pipeline::run`] composes the stages below and stops at the [goal](pipeline::Goal). Each stage is a public function
//! over plain data with an options struct, and can be used separately.
//!
//! | stage | function | result |
//! |---|---|---|
//! | detection | [`detect::detect_keypoints`] | keypoints of photos without a keypoint file |
//! | estimate | [`estimate::estimate_keypoints`] | the same without a detector, less accurate |
//! | avatar | [`pipeline::make_avatar`] | a mannequin of the person's stature, or a given avatar |
//! | skeleton | [`skeleton_fit::fit_skeleton`] | one skeleton, the pose in each view, one camera |
//! | segmentation | [`segment::segment`] | a soft silhouette of each view |
//! | body fit | [`body_fit::fit_body`] | one body for all silhouettes, refined poses and camera |
//! | normalization | [`normalize::normalize`] | silhouettes in the reference pose |
//! | carving | [`carve::carve`] | the visual hull of normalized silhouettes |
//! | colors | [`color::color_surface`] | a color for each vertex of the body |
//! | measurement | [`measure::measure`] | girths, heights and lengths with standard deviations |
//! | sizes | [`sizes::advise_person`] | recommended garment sizes |
//!
//! With [`Method::Fit`](pipeline::Method::Fit) (default), the fitted body is the result. With
//! [`Method::ThreeStep`](pipeline::Method::ThreeStep), each view is normalized separately as published, and the body is
//! the visual hull.
//!
//! # Errors and warnings
//!
//! Unusable input is rejected with an error that states the view, the value, the limit and the remedy. A view that a
//! stage rejects is dropped with a [warning](pipeline::Warning) while enough views remain. A measurement that cannot be
//! determined is [missing with its reason](measure::Unavailable).
//!
//! # Features
//!
//! - `parallel` (default): multithreading with rayon. Results are equal without it.
//!
//! # Source
//! Zwettler et al., "Three-step Alignment Approach for Fitting a Normalized Mask of a Person Rotating in A-Pose or
//! T-Pose", VISAPP 2021, for [`normalize`] and [`carve`]; each module names its other sources.

pub mod body_fit;
pub mod carve;
pub mod check;
pub mod color;
pub mod detect;
pub mod estimate;
pub mod measure;
pub mod mesh_scan;
pub mod normalize;
pub mod pipeline;
pub mod scale;
pub mod scan;
pub mod segment;
pub mod sizes;
pub mod skeleton_fit;
pub mod skirt;
pub mod video;
pub mod view;

mod initial_body;

pub use pirouette_body as body;
pub use pirouette_geom as geom;
pub use pirouette_pose as pose;
pub use pirouette_segment as segmentation;

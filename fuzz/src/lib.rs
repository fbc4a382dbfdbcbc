//! Readers of bytes from outside, one function per fuzz target.
//!
//! Any bytes must give a value or an error. What is accepted must also be usable: a mesh can be checked, a network can be
//! run. Panics, and memory beyond the limit of the fuzzer, are defects.

use std::sync::Arc;

use pirouette_body::{Joint, ReferencePose};
use pirouette_files::formats::keypoints::KeypointFile;
use pirouette_files::formats::{charts, manifest, mesh, photo, points};
use pirouette_files::scan_folder::{LoadOptions, load_source};
use pirouette_files::source::Source;
use pirouette_pose::{Photo, PoseModel, Region};

/// A network of the pose detector; accepted ones are run on a small photo
pub fn network(bytes: &[u8]) {
    let Ok(model) = PoseModel::parse(bytes) else {
        return;
    };
    let pixels: Vec<[u8; 3]> = (0..60).map(|i| [i * 4, 255 - i * 4, i]).collect();
    let photo = Photo::new(10, 6, &pixels).expect("the size is that of the pixels");
    let region = model.search(&photo).unwrap_or(Region::containing(&photo));
    let found = model.detect(&photo, &region, 2, true);
    assert!(found.mask.is_some());
}

/// A keypoint file in any readable format, used for four photos
pub fn keypoints(bytes: &[u8]) {
    let Ok(file) = KeypointFile::parse(bytes) else {
        return;
    };
    let photos = ["000.jpg", "045.jpg", "090.jpg", "135.jpg"];
    for index in file.match_photos(&photos).into_iter().chain([None]) {
        let Ok(found) = file.detection(index, 800, 1000) else {
            continue;
        };
        for joint in Joint::ALL {
            if let Some(keypoint) = found.keypoints.found(joint) {
                assert!(keypoint.position.is_finite());
                assert!((0.0..=1.0).contains(&keypoint.confidence));
            }
        }
    }
}

/// A manifest: scan.json
pub fn manifest(bytes: &[u8]) {
    if let Ok(found) = manifest::parse_manifest(bytes) {
        let positive = |value: Option<f64>| value.is_none_or(|v| v.is_finite() && v > 0.0);
        assert!(positive(found.stature_mm) && positive(found.mm_per_px));
    }
}

/// Meshes: PLY, OBJ, OFF
pub fn meshes(bytes: &[u8]) {
    let meshes = [
        mesh::read_ply(bytes),
        mesh::read_obj(bytes),
        mesh::read_off(bytes),
        mesh::read_stl(bytes),
        mesh::MeshFormat::Glb.read(bytes),
    ];
    for mesh in meshes.into_iter().flatten() {
        let count = mesh.positions.len();
        let corners = mesh.triangles.as_flattened();
        assert!(corners.iter().all(|&vertex| (vertex as usize) < count));
        // Closed or not, the check ends.
        let _ = mesh.check();
    }
}

/// A reference avatar: glTF or VRM
pub fn avatar(bytes: &[u8]) {
    let _ = pirouette_body::gltf::load_avatar(bytes, ReferencePose::A);
}

/// Lists of points (CSV) and size charts (TOML)
pub fn tables(bytes: &[u8]) {
    if let Ok(points) = points::parse_points(bytes) {
        assert!(points.iter().all(|point| point.is_finite()));
    }
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = charts::parse_charts(text);
    }
}

/// Photos and masks: JPEG, PNG, WebP, with EXIF data
pub fn photos(bytes: &[u8]) {
    let _ = photo::decode_photo(bytes);
    let _ = photo::decode_mask(bytes);
}

/// A zip file of a scan folder
pub fn scan(bytes: &[u8]) {
    if let Ok(source) = Source::from_zip("scan.zip", Arc::<[u8]>::from(bytes)) {
        let _ = load_source(source, &LoadOptions::default());
    }
}

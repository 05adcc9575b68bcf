//! System packages that cargo cannot install: a Vulkan driver and X11 libraries for a window.

use std::{
    env, fs,
    process::{Command, Stdio},
};

use anyhow::{Result, ensure};

use crate::steps::{Steps, is_installed};

/// Software Vulkan, for machines without any other driver.
const VULKAN: [&str; 1] = ["mesa-vulkan-drivers"];

/// Libraries that a window on X11 loads at run time.
const WINDOW: [&str; 5] = ["libx11-6", "libx11-xcb1", "libxcursor1", "libxi6", "libxkbcommon-x11-0"];

/// A display without a screen, in which examples are started.
const VIRTUAL_DISPLAY: [&str; 1] = ["xvfb"];

/// Folders in which Vulkan's loader looks for drivers.
const DRIVERS: [&str; 3] = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d"];

/// Whether there is a display: X11 or Wayland on Linux. Other systems always have one.
pub fn has_display() -> bool {
    !cfg!(target_os = "linux")
        || ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| env::var_os(name).is_some_and(|v| !v.is_empty()))
}

/// Installs the missing packages for drawing with Vulkan, and into a window if `window` is set. Does nothing on
/// systems other than Debian and its derivatives.
///
/// # Errors
/// If this program lacks the rights. The message has the command to run.
pub fn install_graphics(steps: &mut Steps, window: bool) -> Result<()> {
    // Any driver will do, so a machine with a real GPU gets no software Vulkan.
    let wanted = VULKAN.iter().filter(|_| !has_vulkan_driver()).chain(WINDOW.iter().filter(|_| window));
    let missing = missing(wanted);
    ensure!(
        missing.is_empty() || can_install(),
        "{0} missing, and installing them needs root. Run: sudo apt-get install {0}",
        missing.join(" ")
    );
    install(steps, &missing)
}

/// The packages that a window in a display without a screen needs and that are not there, after an attempt to
/// install them where this program has the rights. Knows nothing to be missing on systems other than Debian and
/// its derivatives.
pub fn missing_for_virtual_display() -> Vec<&'static str> {
    let wanted = || WINDOW.iter().chain(&VIRTUAL_DISPLAY);
    let packages = missing(wanted());
    if packages.is_empty() || !can_install() {
        return packages;
    }
    let install = ["install", "-y", "--no-install-recommends"];
    for mut command in [apt(&["update"]), apt(&[&install[..], &packages].concat())] {
        // What it could not do is missing below.
        let _ = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
    }
    missing(wanted())
}

/// The packages among `wanted` that Debian's tools miss.
fn missing<'a>(wanted: impl Iterator<Item = &'a &'static str>) -> Vec<&'static str> {
    if !cfg!(target_os = "linux") || !is_installed("dpkg-query") {
        return Vec::new();
    }
    wanted.copied().filter(|package| !has_package(package)).collect()
}

fn install(steps: &mut Steps, packages: &[&str]) -> Result<()> {
    if packages.is_empty() {
        return Ok(());
    }
    // A fresh container has no lists, and without them nothing can be installed.
    steps.run("package lists", &mut apt(&["update"]))?;
    steps
        .run("system packages", &mut apt(&[&["install", "-y", "--no-install-recommends"], packages].concat()))
}

/// `apt-get` with these arguments, as root.
fn apt(arguments: &[&str]) -> Command {
    // `-n`: sudo must not ask for a password in the middle of a run.
    let words: Vec<&str> = if is_root() { vec![] } else { vec!["sudo", "-n"] };
    let words: Vec<&str> = words.into_iter().chain(["apt-get"]).chain(arguments.iter().copied()).collect();
    let mut command = Command::new(words[0]);
    command.args(&words[1..]).env("DEBIAN_FRONTEND", "noninteractive");
    command
}

fn can_install() -> bool {
    is_root() || has_sudo()
}

fn has_vulkan_driver() -> bool {
    DRIVERS.iter().any(|folder| fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()))
}

fn has_package(name: &str) -> bool {
    let query = Command::new("dpkg-query").args(["-W", "-f", "${db:Status-Status}", name]).output();
    // `dpkg-query` also succeeds for a package that was removed and left its configuration.
    query.is_ok_and(|output| output.stdout.starts_with(b"installed"))
}

fn has_sudo() -> bool {
    Command::new("sudo").args(["-n", "true"]).output().is_ok_and(|output| output.status.success())
}

fn is_root() -> bool {
    let id = Command::new("id").arg("-u").output();
    id.is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}

//! `cargo xtask web`: an app as a static folder for browsers, `web/dist`.

mod serve;
mod toolchain;

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail, ensure};

use crate::{
    files::{copy, copy_files, fresh_folder},
    steps::{Steps, cargo, is_installed, target_folder},
};
use toolchain::{TARGET, Toolchain};

/// The finished folder. Any host of static files serves it.
const DIST: &str = "web/dist";

/// Folder of the page's own files.
const PAGE: &str = "web/page";

/// The package of the custom element, as which the page loads the app too, and the examples of its use. In
/// `web/dist` they have the same places.
const ELEMENT: &str = "web/package";
const ELEMENT_EXAMPLES: &str = "web/examples";

/// The licenses, and the notice of the networks that are compiled in. They go with the package.
const LICENSES: [&str; 3] = ["LICENSE-APACHE", "LICENSE-MIT", "crates/stylegaussian_defaults/NOTICE"];

/// Folders and files of `assets/` that apps load.
const ASSETS: [&str; 3] = ["demo.sgs", "styles", "looks"];

/// The package of the page.
const PAGE_PACKAGE: &str = "stylegaussian_web";

/// An app that is built.
enum App {
    /// The page with the viewer.
    Page,
    /// An example of the workspace, which gets a page with nothing but its canvas.
    Example(String),
}

/// Builds `web/dist`. With `--test`, tests it in Chromium, the page beside the native program; with `--serve`,
/// serves it until the program is ended.
///
/// # Errors
/// If an argument is unknown, if a tool is missing or fails, or if a test fails.
pub fn run(arguments: &[String]) -> Result<()> {
    let (mut app, mut is_served, mut is_tested) = (App::Page, false, false);
    let mut arguments = arguments.iter().map(String::as_str);
    while let Some(argument) = arguments.next() {
        match argument {
            "--serve" => is_served = true,
            "--test" => is_tested = true,
            "--example" => {
                app = App::Example(arguments.next().context("--example: expected a name after it")?.into());
            }
            _ => bail!("found `{argument}`, expected --test, --serve or --example NAME"),
        }
    }
    let mut steps = Steps::default();
    let mut outcome = build(&mut steps, &app);
    if outcome.is_ok() && is_tested {
        outcome = test_built(&mut steps, &app);
    }
    steps.print_summary();
    outcome?;
    print_sizes()?;
    if is_served { serve::serve(Path::new(DIST)) } else { Ok(()) }
}

fn build(steps: &mut Steps, app: &App) -> Result<()> {
    let toolchain = Toolchain::find()?;
    check_wasm_bindgen()?;
    let (selection, name) = match app {
        App::Page => (["--package", PAGE_PACKAGE], PAGE_PACKAGE),
        App::Example(name) => (["--example", name], name.as_str()),
    };
    let mut build = toolchain.cargo("build");
    steps.run("app", build.args(["--locked", "--profile", "web"]).args(selection))?;
    let folder = target_folder().join(TARGET).join("web");
    let wasm = match app {
        App::Page => folder.join(format!("{name}.wasm")),
        App::Example(_) => folder.join("examples").join(format!("{name}.wasm")),
    };
    fresh_folder(Path::new(DIST))?;
    let folder = match app {
        App::Page => Path::new(DIST).join("package"),
        App::Example(_) => DIST.into(),
    };
    let mut bindgen = Command::new("wasm-bindgen");
    bindgen.args(["--target", "web", "--no-typescript", "--out-name", "app", "--out-dir"]).arg(folder);
    // The names of functions, for the stack of a panic, are a third of the module.
    bindgen.args(["--remove-name-section", "--remove-producers-section"]).arg(wasm);
    steps.run("bindings", &mut bindgen)?;
    match app {
        App::Page => {
            copy_files(Path::new(PAGE), Path::new(DIST))?;
            copy_files(Path::new(ELEMENT), &Path::new(DIST).join("package"))?;
            for from in LICENSES.map(Path::new) {
                copy(from, &Path::new(DIST).join("package").join(from.file_name().unwrap_or_default()))?;
            }
            element_examples(steps)?;
        }
        App::Example(_) => copy_files(&Path::new(PAGE).join("example"), Path::new(DIST))?,
    }
    for name in ASSETS {
        copy(&Path::new("assets").join(name), &Path::new(DIST).join("assets").join(name))?;
    }
    Ok(())
}

/// Copies the examples of the element, and bundles the one in React if its packages are installed.
fn element_examples(steps: &mut Steps) -> Result<()> {
    let to = Path::new(DIST).join("examples");
    copy(Path::new(ELEMENT_EXAMPLES), &to)?;
    let bundler = Path::new("web/node_modules/.bin/esbuild");
    if !bundler.exists() {
        steps.not_run("React example", "esbuild is not installed. Run: npm install --prefix web");
        return Ok(());
    }
    let mut bundle = Command::new(bundler);
    bundle.args([
        "web/examples/react/main.jsx",
        "--bundle",
        "--minify",
        "--jsx=automatic",
        "--log-level=warning",
    ]);
    steps.run("React example", bundle.arg(format!("--outfile={}", to.join("react/main.js").display())))
}

/// Folder of the shaders' texts, for a browser's compiler.
const SHADERS: &str = "target/wgsl";

/// Tests of the page without a build for browsers: the page's script, and all shaders; the page's app is
/// checked. Tests whose tools are missing are reported.
///
/// # Errors
/// If a test fails.
pub fn test(steps: &mut Steps) -> Result<()> {
    check(steps)?;
    if let Some(missing) = missing_for_tests() {
        steps.not_run("page", &missing);
        return Ok(());
    }
    steps.run("page", Command::new("node").args(["--test", "web/test/page.mjs", "web/test/element.mjs"]))?;
    // The folder may hold shaders that are gone.
    fresh_folder(Path::new(SHADERS))?;
    let mut write = steps.example("write_sources")?;
    steps.run("shaders' texts", write.arg(SHADERS))?;
    steps.run("shaders in a browser", Command::new("node").args(["web/test/shaders.mjs", SHADERS]))?;
    steps.not_run("page with the app", "it takes a build for browsers. Run: cargo xtask web --test");
    Ok(())
}

/// Checks that the page's app compiles, where builds for browsers are made: a first check of Bevy takes
/// minutes, and machines that have the tools by chance should not wait for it.
fn check(steps: &mut Steps) -> Result<()> {
    let toolchain = match Toolchain::find() {
        Ok(toolchain) => toolchain,
        Err(error) => {
            steps.not_run("web", &error.to_string());
            return Ok(());
        }
    };
    if !target_folder().join(TARGET).join("web").is_dir() {
        steps.not_run("web", "nothing was built for browsers here. Run: cargo xtask web");
        return Ok(());
    }
    let mut check = toolchain.cargo("check");
    steps.run("web", check.args(["--locked", "--profile", "web", "--package", PAGE_PACKAGE]))
}

/// Tests the page that was built, beside the pictures and colors of the native program, or an example, whose
/// first style is painted.
fn test_built(steps: &mut Steps, app: &App) -> Result<()> {
    if let Some(missing) = missing_for_tests() {
        bail!("what was built cannot be tested: {missing}");
    }
    if let App::Example(_) = app {
        return steps.run("example", Command::new("node").args(["--test", "web/test/game.mjs"]));
    }
    let native = ["build", "--locked", "--workspace", "--bin", "stylegaussian"];
    steps.run("native program", &mut cargo(native))?;
    steps.run(
        "page with the app",
        Command::new("node").args([
            "--test",
            "web/test/app.mjs",
            "web/test/limits.mjs",
            "web/test/world.mjs",
            "web/test/examples.mjs",
        ]),
    )
}

/// Something that the tests in a browser need and that is not there, with the way to get it.
fn missing_for_tests() -> Option<String> {
    let chromium = env::var_os("CHROMIUM").map_or_else(|| PathBuf::from("/usr/bin/chromium"), PathBuf::from);
    if !is_installed("node") {
        Some("`node` is not installed".into())
    } else if !Path::new("web/node_modules/playwright-core").exists() {
        Some("Playwright is not installed. Run: npm install --prefix web".into())
    } else if !chromium.is_file() {
        Some(format!("{} is not there; CHROMIUM names another place", chromium.display()))
    } else {
        None
    }
}

/// Checks that `wasm-bindgen` is there, in the version of the library: the two speak a format of their own.
fn check_wasm_bindgen() -> Result<()> {
    let lock = fs::read_to_string("Cargo.lock").context("cannot read Cargo.lock")?;
    let expected = locked_version(&lock, "wasm-bindgen").context("Cargo.lock has no wasm-bindgen")?;
    let output = Command::new("wasm-bindgen").arg("--version").output();
    let found = output.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    let install = format!("cargo install wasm-bindgen-cli --version {expected}");
    let found = found.ok().with_context(|| format!("`wasm-bindgen` is not installed. Run: {install}"))?;
    ensure!(
        found.split(' ').nth(1) == Some(expected),
        "found {found}, expected version {expected}. Run: {install}"
    );
    Ok(())
}

/// The version of a package in a lock file.
fn locked_version<'a>(lock: &'a str, package: &str) -> Option<&'a str> {
    let (_, rest) = lock.split_once(&format!("name = \"{package}\"\nversion = \""))?;
    rest.split('"').next()
}

/// Prints the size of the module, and as brotli sends it if that is installed.
fn print_sizes() -> Result<()> {
    let package = Path::new(DIST).join("package/app_bg.wasm");
    let wasm = if package.is_file() { package } else { Path::new(DIST).join("app_bg.wasm") };
    let bytes = fs::metadata(&wasm).with_context(|| format!("{} is missing", wasm.display()))?.len();
    let megabytes = |bytes: u64| bytes as f64 / 1e6;
    println!("\n{DIST}: a module of {:.1} MB", megabytes(bytes));
    if let Ok(output) = Command::new("brotli").args(["--stdout", "-q", "9"]).arg(&wasm).output()
        && output.status.success()
    {
        println!("compressed with brotli, level 9: {:.1} MB", megabytes(output.stdout.len() as u64));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_of_a_package_is_that_of_its_own_entry() {
        let lock = "name = \"wasm-bindgen-futures\"\nversion = \"0.4.1\"\n\n\
                    name = \"wasm-bindgen\"\nversion = \"0.2.9\"\n";
        assert_eq!(locked_version(lock, "wasm-bindgen"), Some("0.2.9"));
        assert_eq!(locked_version(lock, "wasm"), None);
    }
}

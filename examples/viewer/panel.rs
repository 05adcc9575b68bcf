//! The panel: styles, mix, files, statistics and errors.

use std::{path::PathBuf, time::Duration};

use bevy::{
    diagnostic::{DiagnosticPath, DiagnosticsStore, FrameTimeDiagnosticsPlugin},
    ecs::system::SystemParam,
    prelude::*,
    render::renderer::RenderAdapterInfo,
};
use bevy_egui::{EguiContexts, EguiTextureHandle, egui};
use bevy_stylegaussian::{
    GaussianSceneFailed, StyleApplied, StyleFailed,
    mask::StyleMask,
    scene::SceneReadings,
    style::{StyleProgress, StyleRefined, decoder::StyleBackend},
    stylegaussian_files::writable_extensions,
    world::{GaussianBudget, GaussianWorldFailed, WorldState},
};
use egui::{
    Color32, ComboBox, Grid, LayerId, ProgressBar, RichText, ScrollArea, Slider, TextEdit, Ui, UiBuilder,
};
use stylegaussian_app::{Arrival, Arrivals, Orbit, Subject};

use crate::{
    crop_panel,
    files::OpenFile,
    hand_panel, light,
    parts::{Parts, Tool},
    parts_panel,
    save::{Save, Saving},
    scene::{AXES, ShownScene},
    strokes_panel,
    styles::{Finish, Styles},
    tile::{self, Picture, Tile},
    world_panel,
};

/// Width in points: three paintings and the space between them.
const WIDTH: f32 = 3.0 * tile::SIZE + 41.0;
const ERROR: Color32 = Color32::from_rgb(255, 120, 105);
const DONE: Color32 = Color32::from_rgb(140, 210, 140);

/// The panel itself.
#[derive(Resource, Default)]
pub struct Panel {
    is_hidden: bool,
    /// Hidden in the next frame, for a screenshot.
    is_omitted: bool,
    /// Text of the path field.
    path: String,
}

impl Panel {
    /// Width of the panel in the window, in points. 0 if it is hidden.
    pub fn width(&self) -> f32 {
        if self.is_hidden || self.is_omitted { 0.0 } else { WIDTH }
    }

    /// Hides it in the next frame.
    pub fn omit_once(&mut self) {
        self.is_omitted = true;
    }
}

/// The last message: an error, or the path of a saved file.
#[derive(Resource, Default)]
pub struct Notice(Option<Result<String, String>>);

impl Notice {
    /// Shows and logs an error.
    pub fn fail(&mut self, error: String) {
        error!("{error}");
        self.0 = Some(Err(error));
    }

    /// Shows the path of a saved file, or the error.
    pub fn tell_saved(&mut self, saved: Result<PathBuf, String>) {
        match saved {
            Ok(path) => self.0 = Some(Ok(format!("Saved {}", path.display()))),
            Err(error) => self.fail(error),
        }
    }

    /// Removes the message.
    pub fn clear(&mut self) {
        self.0 = None;
    }
}

/// The change of style under way, and the last one.
#[derive(Resource, Default)]
pub struct Transfer {
    /// Whether a style was requested that is not shown yet.
    pub is_under_way: bool,
    /// Duration and backend of the last change.
    pub last: Option<(Duration, StyleBackend)>,
    /// Steps of the bake that gave the shown look, and whether these are all. `None` if it is as it was
    /// applied.
    pub refined: Option<(u32, bool)>,
}

/// Records the duration of a style, and clears an earlier error.
pub fn note_applied(
    applied: On<StyleApplied>,
    scene: Query<(), With<Subject>>,
    mut transfer: ResMut<Transfer>,
    mut notice: ResMut<Notice>,
) {
    // Parts of the scene have styles of their own.
    if !scene.contains(applied.entity) {
        return;
    }
    let last = Some((applied.elapsed, applied.backend));
    *transfer = Transfer { is_under_way: false, last, refined: None };
    notice.clear();
}

/// Records the progress of a bake.
pub fn note_refined(refined: On<StyleRefined>, mut transfer: ResMut<Transfer>) {
    transfer.refined = Some((refined.steps, refined.is_complete));
}

/// Shows the error of a style.
pub fn note_failed_style(
    failed: On<StyleFailed>,
    mut transfer: ResMut<Transfer>,
    mut notice: ResMut<Notice>,
) {
    transfer.is_under_way = false;
    notice.fail(failed.error.to_string());
}

/// Shows the error of a scene.
pub fn note_failed_scene(failed: On<GaussianSceneFailed>, mut notice: ResMut<Notice>) {
    notice.fail(failed.error.to_string());
}

/// Shows which file of a world cannot be had.
pub fn note_failed_world(failed: On<GaussianWorldFailed>, mut notice: ResMut<Notice>) {
    notice.fail(failed.error.clone());
}

/// F1 hides and shows the panel.
pub fn toggle(keys: Res<ButtonInput<KeyCode>>, mut panel: ResMut<Panel>) {
    if keys.just_pressed(KeyCode::F1) {
        panel.is_hidden = !panel.is_hidden;
    }
}

/// Everything that the panel shows and changes.
#[derive(SystemParam)]
pub struct Shown<'w> {
    panel: ResMut<'w, Panel>,
    styles: ResMut<'w, Styles>,
    arrivals: ResMut<'w, Arrivals>,
    scene: ResMut<'w, ShownScene>,
    readings: Res<'w, SceneReadings>,
    notice: ResMut<'w, Notice>,
    saving: Res<'w, Saving>,
    transfer: Res<'w, Transfer>,
    adapter: Res<'w, RenderAdapterInfo>,
    diagnostics: Res<'w, DiagnosticsStore>,
    parts: ResMut<'w, Parts>,
    budget: ResMut<'w, GaussianBudget>,
    light: ResMut<'w, light::Light>,
    opened: MessageWriter<'w, OpenFile>,
    saved: MessageWriter<'w, Save>,
}

/// Draws the panel at the left of the window.
pub fn draw(
    mut contexts: EguiContexts,
    mut shown: Shown,
    images: Res<Assets<Image>>,
    orbit: Single<&Orbit>,
    mut mask: Single<&mut StyleMask>,
    progress: Query<&StyleProgress>,
    world: Option<Single<&WorldState, With<Subject>>>,
) -> Result {
    // Taken, so that only one frame is drawn without the panel.
    if std::mem::take(&mut shown.panel.is_omitted) || shown.panel.is_hidden {
        return Ok(());
    }
    let pictures: Vec<_> = shown
        .styles
        .list
        .iter()
        .map(|style| {
            let picture = style.picture.as_ref()?;
            let ratio = images.get(picture)?.aspect_ratio().ratio();
            let texture = contexts.add_image(EguiTextureHandle::Strong(picture.clone()));
            Some(Picture { texture, ratio })
        })
        .collect();
    let ctx = contexts.ctx_mut()?;
    // No limit to the duration of a click: with software rendering, press and release may be several slow
    // frames apart.
    ctx.options_mut(|options| options.input_options.max_click_duration = f64::INFINITY);
    let whole = UiBuilder::new().layer_id(LayerId::background()).max_rect(ctx.viewport_rect());
    let mut window = Ui::new(ctx.clone(), "window".into(), whole);
    egui::Panel::left("panel").exact_size(WIDTH).resizable(false).show(&mut window, |ui| {
        ScrollArea::vertical().show(ui, |ui| {
            ui.spacing_mut().item_spacing.y = 5.0;
            scene(ui, &mut shown);
            if let Some(state) = &world {
                world_panel::draw(ui, &mut shown.budget, state);
            }
            ui.separator();
            let pins = shown.parts.tool == Tool::Pin;
            paintings(ui, &mut shown.styles, &pictures, pins);
            crop_panel::draw(ui, &mut shown.styles, &pictures);
            ui.separator();
            let refined = shown.transfer.refined;
            if mix(ui, &mut shown.styles, &mut shown.arrivals, refined) {
                shown.saved.write(Save::Pins);
            }
            // Always as high, so that nothing moves when it comes and goes.
            let read = shown.scene.coming().and_then(|coming| shown.readings.progress(coming));
            let share = read.or_else(|| progress.iter().find_map(|of| of.style.or(of.refine)));
            let bar = ProgressBar::new(share.unwrap_or_default()).desired_height(3.0);
            ui.add_visible(share.is_some(), bar);
            ui.separator();
            parts(ui, &mut shown, &orbit, &mut mask);
            ui.separator();
            light::draw(ui, &mut shown.light);
            ui.separator();
            save(ui, &mut shown);
            ui.separator();
            statistics(ui, &shown);
            controls(ui);
        });
    });
    parts_panel::draw_lasso(window.painter(), &shown.parts.lasso);
    notice(&mut window, &mut shown.notice);
    Ok(())
}

/// Paint and volumes.
fn parts(ui: &mut Ui, shown: &mut Shown, orbit: &Orbit, mask: &mut StyleMask) {
    // Without a change, nothing is shown anew.
    let parts = shown.parts.bypass_change_detection();
    let before = parts.shown();
    let wishes = parts_panel::draw(ui, parts, &shown.styles, orbit, shown.scene.is_world);
    if let Some(again) = wishes.step {
        parts.step(again, mask, &mut shown.styles);
    }
    if wishes.clear_paint {
        parts.clear_paint(mask);
    }
    if wishes.save_mask {
        shown.saved.write(Save::Mask);
    }
    if shown.parts.shown() != before {
        shown.parts.set_changed();
    }
}

/// The scene's name, its up axis, and the field to open another file.
fn scene(ui: &mut Ui, shown: &mut Shown) {
    ui.horizontal(|ui| {
        match &shown.scene.loading {
            Some((path, _)) => {
                ui.spinner();
                ui.label(path.file_name().unwrap_or_default().to_string_lossy());
            }
            None => {
                ui.heading(&shown.scene.name);
            }
        }
        let up = AXES.iter().find(|(_, axis)| *axis == shown.scene.framing.up);
        let current = up.map_or("tilted", |&(name, _)| name);
        let before = shown.scene.framing.up;
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let said = if shown.scene.up_is_told { "as its file says" } else { "its file does not say" };
            ComboBox::from_id_salt("up")
                .width(48.0)
                .selected_text(current)
                .show_ui(ui, |ui| {
                    for (name, axis) in AXES {
                        ui.selectable_value(&mut shown.scene.framing.up, axis, name);
                    }
                })
                .response
                .on_hover_text(said);
            ui.label("up");
        });
        // From now on it is the user's choice and no longer the file's.
        if shown.scene.framing.up != before {
            shown.scene.up_is_told = false;
        }
    });
    ui.horizontal(|ui| {
        let hint = "scene, image, style or look: drop it, or its path";
        let field =
            ui.add(TextEdit::singleline(&mut shown.panel.path).hint_text(hint).desired_width(WIDTH - 78.0));
        // egui takes the focus away on Enter, but also on a click elsewhere.
        let entered = field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
        if (ui.button("Open").clicked() || entered) && !shown.panel.path.trim().is_empty() {
            // The field is empty for the next path.
            let path = std::mem::take(&mut shown.panel.path);
            shown.opened.write(OpenFile(path.trim().into()));
        }
    });
}

/// The captured colors, then every style with its weight. With the tool that pins, a click on a used one is its
/// spot to be pinned.
fn paintings(ui: &mut Ui, styles: &mut Styles, pictures: &[Option<Picture>], pins: bool) {
    let total = styles.total();
    // Noted, and applied after the loop that borrows the list.
    let (mut selected, mut spot) = (None, None);
    let n_tiles = styles.list.len() + 1;
    for first in (0..n_tiles).step_by(3) {
        ui.horizontal(|ui| {
            for number in first..(first + 3).min(n_tiles) {
                ui.vertical(|ui| {
                    let Some(index) = number.checked_sub(1) else {
                        let own = Tile {
                            caption: "0  unstyled",
                            picture: None,
                            is_used: total == 0.0,
                            percent: None,
                        };
                        if tile::draw(ui, &own).is_some() {
                            selected = Some(None);
                        }
                        return;
                    };
                    let style = &mut styles.list[index];
                    let key = if number <= 8 { format!("{number}  ") } else { String::new() };
                    let is_used = style.weight > 0.0;
                    let tile = Tile {
                        caption: &format!("{key}{}", style.name),
                        picture: pictures[index],
                        is_used,
                        percent: is_used.then(|| 100.0 * style.weight / total),
                    };
                    match tile::draw(ui, &tile) {
                        Some(at) if pins && is_used => spot = Some((index, Vec2::new(at.x, at.y))),
                        Some(_) => selected = Some(Some(index)),
                        None => {}
                    }
                    tile::weight(ui, &mut style.weight);
                });
            }
        });
    }
    if let Some(selected) = selected {
        styles.select(selected);
    }
    if spot.is_some() {
        styles.spot = spot;
    }
}

/// The choice of how far a style is worked out.
const FINISHES: [(Finish, &str, &str); 3] = [
    (Finish::Instant, "instant", "the painting's paint at once"),
    (Finish::Refined, "refined", "baked further in the background while it is shown"),
    (Finish::Baked, "baked", "as it was baked before; refined if it was not"),
];

/// The choice of the way in which styles arrive.
const ARRIVALS: [(Arrival, &str, &str); 4] = [
    (Arrival::Fade, "fading", "everywhere at once"),
    (Arrival::Sphere, "as a wave", "from the middle of the view"),
    (Arrival::Front, "across", "from left to right"),
    (Arrival::Spots, "in spots", "that grow together"),
];

/// The sliders for content and fade, and how far the style that is shown is refined. Returns whether pins are
/// to be saved.
fn mix(ui: &mut Ui, styles: &mut Styles, arrivals: &mut Arrivals, refined: Option<(u32, bool)>) -> bool {
    let mut saves_pins = false;
    let look = match refined {
        _ if styles.total() == 0.0 => "unstyled".to_owned(),
        _ if styles.has_look() => "baked".to_owned(),
        None => "instant".to_owned(),
        Some((steps, false)) => format!("refined by {steps} steps so far"),
        Some((steps, true)) => format!("refined by {steps} steps"),
    };
    ui.spacing_mut().slider_width = WIDTH - 170.0;
    Grid::new("mix").num_columns(2).show(ui, |ui| {
        ui.label("content").on_hover_text("how much of the scene's own colors stays");
        ui.add(Slider::new(&mut styles.content, 0.0..=1.0).fixed_decimals(2));
        ui.end_row();
        strokes_panel::draw(ui, styles);
        saves_pins = hand_panel::rows(ui, styles);
        ui.label("fade").on_hover_text("from look to look");
        ui.add(Slider::new(&mut arrivals.seconds, 0.0..=3.0).fixed_decimals(1).suffix(" s"));
        ui.end_row();
        ui.label("arrives").on_hover_text("the way in which a look takes the place of another");
        ui.horizontal(|ui| {
            for (way, text, hint) in ARRIVALS {
                ui.selectable_value(&mut arrivals.way, way, text).on_hover_text(hint);
            }
        });
        ui.end_row();
        ui.label("finish").on_hover_text("how far a style is worked out");
        ui.horizontal(|ui| {
            for (finish, text, hint) in FINISHES {
                ui.selectable_value(&mut styles.finish, finish, text).on_hover_text(hint);
            }
        });
        ui.end_row();
        ui.label("shown");
        ui.label(look);
        ui.end_row();
    });
    saves_pins
}

/// The save buttons.
fn save(ui: &mut Ui, shown: &mut Shown) {
    ui.horizontal_wrapped(|ui| {
        ui.label("save");
        if ui.button("picture").clicked() {
            shown.saved.write(Save::Screenshot);
        }
        let is_world = shown.scene.is_world;
        ui.add_enabled_ui(!shown.saving.is_under_way() && !is_world, |ui| {
            for extension in writable_extensions() {
                let button = ui.button(format!(".{extension}"));
                let button = button.on_hover_text("the scene in the colors that it is shown in");
                let button =
                    if is_world { button.on_disabled_hover_text(world_panel::NO_FILE) } else { button };
                if button.clicked() {
                    shown.saved.write(Save::Scene(extension));
                }
            }
        });
        if shown.saving.is_under_way() {
            ui.spinner();
        }
    });
}

/// The message, over the image.
fn notice(window: &mut Ui, notice: &mut Notice) {
    let Some(told) = &notice.0 else { return };
    let (text, color) = match told {
        Ok(text) => (text, DONE),
        Err(text) => (text, ERROR),
    };
    let corner = window.max_rect().left_bottom() + egui::vec2(WIDTH + 14.0, -14.0);
    let area = egui::Area::new("notice".into()).pivot(egui::Align2::LEFT_BOTTOM).fixed_pos(corner);
    let shown = area.show(window.ctx(), |ui| {
        egui::Frame::popup(ui.style()).inner_margin(10.0).show(ui, |ui| {
            ui.set_max_width((window.max_rect().width() - WIDTH - 60.0).min(620.0));
            ui.add(egui::Label::new(RichText::new(text).color(color)).wrap());
        });
    });
    if shown.response.interact(egui::Sense::click()).on_hover_text("click to dismiss").clicked() {
        notice.clear();
    }
}

fn statistics(ui: &mut Ui, shown: &Shown) {
    let smoothed =
        |path: &DiagnosticPath| shown.diagnostics.get(path).and_then(|diagnostic| diagnostic.smoothed());
    let frame = smoothed(&FrameTimeDiagnosticsPlugin::FRAME_TIME).unwrap_or(0.0);
    let rate = smoothed(&FrameTimeDiagnosticsPlugin::FPS).unwrap_or(0.0);
    let transfer = match shown.transfer.last {
        _ if shown.transfer.is_under_way => "...".to_owned(),
        Some((elapsed, backend)) => format!("{:.0} ms, {backend:?}", 1e3 * elapsed.as_secs_f32()),
        None => "-".to_owned(),
    };
    let adapter = format!("{} ({:?})", shown.adapter.name, shown.adapter.backend);
    let rows = [
        ("Gaussians", shown.scene.n_gaussians.to_string()),
        ("transfer", transfer),
        ("frame", format!("{frame:.1} ms, {rate:.1} fps")),
        ("adapter", adapter),
    ];
    Grid::new("statistics").num_columns(2).spacing([14.0, 2.0]).show(ui, |ui| {
        for (name, value) in rows {
            ui.weak(name);
            ui.add(egui::Label::new(value).truncate());
            ui.end_row();
        }
    });
}

fn controls(ui: &mut Ui) {
    ui.collapsing("mouse and keys", |ui| {
        ui.weak(
            "drag: orbit (right: look, middle: pan)\nwheel: zoom    W A S D Q E, Shift: fly    F: all of it",
        );
        ui.weak("1 to 8: style    0: none    F1: hide this panel");
    });
}

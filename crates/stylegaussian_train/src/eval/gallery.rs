//! The evaluation itself: every painting on every view, beside the references.

use std::path::{Path, PathBuf};

use glam::UVec2;
use stylegaussian::{
    Camera, Decoder, EncoderId, Scene,
    paint::{Canvas, Painted, Surface},
    recolor::{ColorMoments, Recoloring},
    restyle::{Recipe, Styles},
    splat::{Colors, RenderedImage, render},
    split::split_paint,
    views::{choose_views, orbit},
    work::Work,
};
use stylegaussian_encoder::{Encoder, Image, StyleSize, paint_of, style_statistics};

use super::{
    baseline::Baseline,
    consistency::{Agreement, Consistency, N_ORBIT, Pairs},
    image_decoder::ImageDecoder,
    judge::{Judge, Look, Target, nearest_other},
    mesh::Ball,
    report::{Evaluation, Measures, PaintingEvaluation},
};
use crate::{
    cameras::scaled,
    contact_sheet::contact_sheet,
    error::{TrainError, ensure},
    picture::{Background, Picture, draw},
    watch::{Stage, Watch},
};

/// Side of a contact sheet's pictures, in pixels.
const SHEET_SIDE: u32 = 160;

/// A scene in the style of a painting, given its file and its picture: colors, and strokes over them if there
/// are any.
pub type Painter<'a> = dyn Fn(&Path, &Image) -> Result<Painted, TrainError> + 'a;

/// The scene that is evaluated, and how it gets its colors.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Gives the scene a painting's colors and strokes: [`decoded`], instant paint, or looks that were baked
    /// before.
    pub painter: &'a Painter<'a>,
    /// How many times as many Gaussians the scene is split into, with its strokes in their colors, if it is
    /// judged as programs show it that draw no strokes: see [`split_paint`].
    pub split: Option<f64>,
    /// The surface of the scene, if a mesh is painted beside it and judged, too. `painter` then lays on instant
    /// paint.
    pub mesh: Option<&'a Surface>,
    /// The encoder of AdaIN on each view.
    pub encoder: &'a Encoder,
}

/// Colors from `decoder`, for a scene that was embedded with `encoder`. `name` is the scene's in messages.
///
/// # Errors
/// If the scene has no features, or the parts belong to different encoders.
pub fn decoded<'a>(
    name: &str,
    scene: &'a Scene,
    decoder: &'a Decoder,
    encoder: &'a Encoder,
) -> Result<impl Fn(&Path, &Image) -> Result<Painted, TrainError> + 'a, TrainError> {
    let Some(features) = scene.features.as_ref() else {
        return Err(TrainError::Invalid(format!("{name}: no features: embed it first")));
    };
    let expected = ("the encoder", Some(encoder.id()));
    EncoderId::expect_same((name, features.encoder.as_ref()), expected)?;
    EncoderId::expect_same(("the decoder", decoder.encoder.as_ref()), expected)?;
    Ok(move |_: &Path, image: &Image| {
        let style = style_statistics(encoder, image, StyleSize::default())?;
        let mut decoder = decoder;
        let styles = Styles::Decoded { styles: vec![(&style, 1.0)], decode: &mut decoder };
        let recipe = Recipe { looks: Vec::new(), styles, content: 0.0 };
        recipe.restyle(scene, &Work::default()).map_err(|error| TrainError::Caused(error.into()))
    })
}

/// The views on which a scene is evaluated.
pub struct Views {
    /// For style and content.
    cameras: Vec<Camera>,
    /// For the agreement between views.
    consistency: Consistency,
}

impl Views {
    /// `n` views chosen to suit the scene, with a longer side of `size` pixels. Consistency is measured on an
    /// orbit with views of `consistency_size` pixels.
    ///
    /// # Errors
    /// If no camera can see the scene.
    pub fn choose(scene: &Scene, n: usize, size: u32, consistency_size: u32) -> Result<Self, TrainError> {
        let consistency = on_orbit(scene, consistency_size)?;
        Ok(Self { cameras: choose_views(scene, n, UVec2::splat(size)), consistency })
    }

    /// `n` of these cameras, spread over the list. Consistency is measured on `pairs` of the cameras, or on an
    /// orbit if there are none.
    ///
    /// # Errors
    /// If there are no pairs, and no camera on the orbit can see the scene.
    pub fn of_cameras(
        scene: &Scene,
        cameras: &[Camera],
        n: usize,
        [size, consistency_size]: [u32; 2],
        pairs: Option<&Pairs>,
    ) -> Result<Self, TrainError> {
        let at = |size| {
            cameras
                .iter()
                .map(|camera| scaled(&camera.near_among(&scene.means), size))
                .collect::<Vec<Camera>>()
        };
        let stride = cameras.len().div_ceil(n).max(1);
        let consistency = match pairs {
            Some(pairs) => Consistency::new(scene, &at(consistency_size), pairs),
            None => on_orbit(scene, consistency_size)?,
        };
        Ok(Self { cameras: at(size).into_iter().step_by(stride).collect(), consistency })
    }
}

fn on_orbit(scene: &Scene, size: u32) -> Result<Consistency, TrainError> {
    let cameras = orbit(scene, N_ORBIT, UVec2::splat(size));
    let n = scene.len();
    ensure!(
        !cameras.is_empty() && cameras.iter().all(Camera::is_usable),
        "no camera sees the scene of {n} Gaussians: none is visible, or they lie too far apart"
    );
    Ok(Consistency::new(scene, &cameras, &Pairs::of_orbit()?))
}

/// Result of an evaluation.
pub struct Outcome {
    /// The numbers.
    pub evaluation: Evaluation,
    /// A contact sheet with a row for each painting, the unstyled scene first.
    pub sheet: Picture,
}

/// Evaluates a scene's colors in the styles of paintings. If `decoder_2d` is given, AdaIN on each view
/// separately is a further reference.
///
/// # Errors
/// If an image cannot be read, the painter fails, or `watch` interrupts.
pub fn evaluate(
    subject: Subject,
    views: &Views,
    judge: Judge,
    paintings: Vec<PathBuf>,
    decoder_2d: Option<&ImageDecoder>,
    watch: Watch,
) -> Result<Outcome, TrainError> {
    let gallery = Gallery::new(subject, views, judge, paintings, decoder_2d)?;
    let total = (gallery.paintings.len() * gallery.unstyled.len()) as u32;
    let mut done = 0;
    let mut sheet = vec![sheet_row(None, &gallery.unstyled)];
    let mut exhibits = Vec::new();
    for (own, painting) in gallery.paintings.iter().enumerate() {
        let mut exhibit = gallery.exhibit(own, || {
            if watch.is_interrupted() {
                return Err(TrainError::Interrupted);
            }
            done += 1;
            watch.report(Stage::Evaluation, done, total);
            Ok(())
        })?;
        // Taken out, because the renders of all paintings would fill the memory.
        sheet.push(sheet_row(Some(painting), &std::mem::take(&mut exhibit.pictures)));
        exhibits.push(exhibit);
    }
    let sheet = contact_sheet(&sheet, UVec2::splat(SHEET_SIDE));
    Ok(Outcome { evaluation: gallery.evaluation(&exhibits)?, sheet })
}

/// The unstyled views, the paintings, and the networks that compare them.
struct Gallery<'a> {
    subject: Subject<'a>,
    judge: Judge,
    views: &'a Views,
    unstyled: Vec<RenderedImage>,
    unstyled_looks: Vec<Look>,
    colors: ColorMoments,
    paths: Vec<PathBuf>,
    paintings: Vec<Image>,
    /// The same paintings as the judge sees them.
    targets: Vec<Target>,
    /// For the views of style and content, and for those of consistency.
    baselines: Option<[Baseline<'a>; 2]>,
    /// The mesh, if one is judged.
    ball: Option<Ball<'a>>,
}

/// The scene in one style, measured view by view.
struct Exhibit {
    stylized: Vec<Measures>,
    mesh: Vec<Measures>,
    unstyled: Vec<Measures>,
    recolored: Vec<Measures>,
    adain_2d: Vec<Measures>,
    agreement: Agreement,
    adain_2d_agreement: Option<Agreement>,
    out_of_range: f64,
    pictures: Vec<RenderedImage>,
}

impl<'a> Gallery<'a> {
    fn new(
        subject: Subject<'a>,
        views: &'a Views,
        judge: Judge,
        paths: Vec<PathBuf>,
        decoder_2d: Option<&'a ImageDecoder>,
    ) -> Result<Self, TrainError> {
        let Subject { scene, encoder, mesh, .. } = subject;
        let paintings = paths.iter().map(|path| Image::open_painting(path)).collect::<Result<Vec<_>, _>>()?;
        let unstyled: Vec<RenderedImage> =
            views.cameras.iter().map(|camera| render(scene, Colors::Captured, camera)).collect();
        let baselines = |decoder_2d| -> Result<_, TrainError> {
            let of = |views: &[RenderedImage]| Baseline::new(decoder_2d, encoder, views);
            Ok([of(&unstyled)?, of(views.consistency.unstyled())?])
        };
        Ok(Self {
            baselines: decoder_2d.map(baselines).transpose()?,
            ball: mesh.map(|surface| Ball::new(scene, surface)).transpose()?,
            targets: paintings.iter().map(|image| judge.painting(image)).collect::<Result<_, _>>()?,
            unstyled_looks: unstyled.iter().map(|view| judge.look(view)).collect::<Result<_, _>>()?,
            colors: ColorMoments::of_views(&unstyled),
            subject,
            judge,
            views,
            unstyled,
            paths,
            paintings,
        })
    }

    /// The scene in the style of painting `own`. Calls `report` after every view.
    fn exhibit(
        &self,
        own: usize,
        mut report: impl FnMut() -> Result<(), TrainError>,
    ) -> Result<Exhibit, TrainError> {
        let Subject { scene, painter, split, encoder, .. } = self.subject;
        let image = &self.paintings[own];
        let painted = painter(&self.paths[own], image)?;
        // The scene's own features are another matter: this baseline has feature maps of its own.
        let style = match &self.baselines {
            Some(_) => Some(style_statistics(encoder, image, StyleSize::default())?),
            None => None,
        };
        let mesh = match &self.ball {
            Some(ball) => {
                let paint = ball.paint(&Canvas::new(&paint_of(image)), &painted)?;
                Some((ball, ball.bare(&paint), paint))
            }
            None => None,
        };
        let recoloring = Recoloring::new(&self.colors, &ColorMoments::of_rgb(&image.rgb));
        let split = split.map(|factor| split_by(scene, &painted, factor)).transpose()?;
        let draw = |camera: &Camera| match &split {
            Some(split) => render(split, Colors::Captured, camera),
            None => draw(scene, &painted, camera),
        };
        let consistency = &self.views.consistency;
        let drawn: Vec<RenderedImage> = consistency.cameras().map(draw).collect();
        let mut exhibit = Exhibit {
            agreement: consistency.measure(&self.judge, &drawn)?,
            adain_2d_agreement: None,
            stylized: Vec::new(),
            mesh: Vec::new(),
            unstyled: Vec::new(),
            recolored: Vec::new(),
            adain_2d: Vec::new(),
            out_of_range: 0.0,
            pictures: self.views.cameras.iter().map(draw).collect(),
        };
        for (i, (before, view)) in self.unstyled.iter().zip(&exhibit.pictures).enumerate() {
            let measure = |look: &Look| look.measures(&self.unstyled_looks[i], &self.targets, own);
            exhibit.stylized.push(measure(&self.judge.look(view)?));
            exhibit.unstyled.push(measure(&self.unstyled_looks[i]));
            exhibit.recolored.push(measure(&self.judge.look(&recoloring.view(before))?));
            if let Some((ball, bare, paint)) = &mesh {
                let camera = &self.views.cameras[i];
                let bare = self.judge.look(&ball.draw(bare, camera))?;
                let look = self.judge.look(&ball.draw(paint, camera))?;
                exhibit.mesh.push(look.measures(&bare, &self.targets, own));
            }
            if let Some(([baseline, _], style)) = self.baselines.as_ref().zip(style.as_ref()) {
                exhibit.adain_2d.push(measure(&self.judge.look(&baseline.paint(i, before, style)?)?));
            }
            exhibit.out_of_range += share_out_of_range(view) / self.unstyled.len() as f64;
            report()?;
        }
        if let Some(([_, baseline], style)) = self.baselines.as_ref().zip(style.as_ref()) {
            let paint = |(i, before)| baseline.paint(i, before, style);
            let drawn =
                consistency.unstyled().iter().enumerate().map(paint).collect::<Result<Vec<_>, _>>()?;
            exhibit.adain_2d_agreement = Some(consistency.measure(&self.judge, &drawn)?);
        }
        Ok(exhibit)
    }

    fn evaluation(&self, exhibits: &[Exhibit]) -> Result<Evaluation, TrainError> {
        let mean = |kind: fn(&Exhibit) -> &Vec<Measures>| {
            Measures::mean(&exhibits.iter().flat_map(kind).copied().collect::<Vec<_>>())
        };
        let agreement = |of: &dyn Fn(&Exhibit) -> Option<Agreement>| {
            exhibits.iter().map(of).collect::<Option<Vec<_>>>().map(|all| Agreement::mean(&all))
        };
        let (stylized, recolored) = (mean(|e| &e.stylized), mean(|e| &e.recolored));
        let deep = |measures: &Measures| measures.style_errors[1] + measures.style_errors[2];
        let consistency = &self.views.consistency;
        Ok(Evaluation {
            deep_style_error_over_recolored: deep(&stylized) / deep(&recolored).max(f64::MIN_POSITIVE),
            stylized,
            mesh: self.ball.as_ref().map(|_| mean(|e| &e.mesh)),
            unstyled: mean(|e| &e.unstyled),
            recolored,
            adain_2d: self.baselines.as_ref().map(|_| mean(|e| &e.adain_2d)),
            consistency: agreement(&|e| Some(e.agreement)).unwrap_or_default(),
            unstyled_consistency: consistency.measure(&self.judge, consistency.unstyled())?,
            adain_2d_consistency: agreement(&|e| e.adain_2d_agreement),
            out_of_range: exhibits.iter().map(|e| e.out_of_range).sum::<f64>() / exhibits.len().max(1) as f64,
            paintings: exhibits.iter().enumerate().map(|(own, exhibit)| self.row(own, exhibit)).collect(),
        })
    }

    fn row(&self, own: usize, exhibit: &Exhibit) -> PaintingEvaluation {
        PaintingEvaluation {
            path: self.paths[own].clone(),
            nearest_other: nearest_other(&self.targets, own),
            stylized: Measures::mean(&exhibit.stylized),
            recolored: Measures::mean(&exhibit.recolored),
        }
    }
}

/// The scene that holds its strokes in the colors of split Gaussians.
fn split_by(scene: &Scene, painted: &Painted, factor: f64) -> Result<Scene, TrainError> {
    let mut split = scene.clone();
    split_paint(&mut split, painted, factor, &Work::default())
        .map_err(|canceled| TrainError::Caused(canceled.into()))?;
    Ok(split)
}

/// The share of color values outside 0..1, in pixels of which the scene covers more than half.
fn share_out_of_range(view: &RenderedImage) -> f64 {
    let covered = || view.color.iter().zip(&view.alpha).filter(|(_, alpha)| **alpha > 0.5);
    // Colors are premultiplied, so the largest displayable value is alpha. Rounding within a hundredth is not
    // out of range.
    let outside = covered().flat_map(|(color, alpha)| color.map(|c| c < -0.01 || c > alpha + 0.01));
    outside.filter(|outside| *outside).count() as f64 / (3 * covered().count().max(1)) as f64
}

fn sheet_row(painting: Option<&Image>, views: &[RenderedImage]) -> Vec<Picture> {
    let first = painting.map_or_else(|| Picture::filled(UVec2::ONE, [255; 4]), Picture::of_image);
    let views = views.iter().map(|view| Picture::of(view, Background::Color([255; 3])));
    std::iter::once(first).chain(views).collect()
}

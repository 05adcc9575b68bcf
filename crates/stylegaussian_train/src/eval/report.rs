//! Results of an evaluation, for programs and for people.

use std::path::PathBuf;

use serde::Serialize;

use super::consistency::Agreement;

/// Results of an evaluation.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// The scene in the paintings' styles.
    pub stylized: Measures,
    /// A mesh beside it in the same paint, if one is judged. Its content error is that to its own colors.
    pub mesh: Option<Measures>,
    /// The scene as it is.
    pub unstyled: Measures,
    /// The scene recolored to each painting's mean color and covariance.
    pub recolored: Measures,
    /// AdaIN on each view separately, if a 2D decoder is given.
    pub adain_2d: Option<Measures>,
    /// Style error of `stylized` at relu2_1 and relu3_1 over that of `recolored`.
    pub deep_style_error_over_recolored: f64,
    /// Agreement of views of the stylized scene, as means over the paintings.
    pub consistency: Agreement,
    /// Agreement of views of the unstyled scene, without view-dependent color.
    pub unstyled_consistency: Agreement,
    /// Agreement of pictures that were painted separately, if a 2D decoder is given.
    pub adain_2d_consistency: Option<Agreement>,
    /// Share of stylized color values outside 0..1, the range that a display shows.
    pub out_of_range: f64,
    /// Painting by painting.
    pub paintings: Vec<PaintingEvaluation>,
}

/// Means over all pictures of one kind.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Measures {
    /// Share of the pictures with the smallest style error for their own painting.
    pub own_painting_nearest: f64,
    /// Style error at relu1_1, relu2_1 and relu3_1.
    pub style_errors: [f64; 3],
    /// Sum of the style errors.
    pub style_error: f64,
    /// Style error at relu4_1, if weights reach that layer.
    pub relu4_1_style_error: Option<f64>,
    /// Share of the pictures whose luminance alone, at equal mean and deviation, has the smallest style error
    /// for their own painting.
    pub texture_own_painting_nearest: f64,
    /// Rank of the own painting among all by that error: 1 is the nearest.
    pub texture_rank: f64,
    /// Style error of the luminance.
    pub texture_error: f64,
    /// Mean cosine distance of a covered cell's features to the nearest in the painting, at relu2_1 and
    /// relu3_1: the mean over those pictures that have a covered cell, `None` if there is none.
    pub nearest_feature_distances: [Option<f64>; 2],
    /// Energy of fine texture over the painting's.
    pub grain: f64,
    /// Content error: mean squared distance of relu3_1 from the unstyled view's.
    pub content_error: f64,
}

/// Results for one painting, as means over the views.
#[derive(Clone, Debug, Serialize)]
pub struct PaintingEvaluation {
    /// The painting's file.
    pub path: PathBuf,
    /// Style error between this painting and the most similar other one. A good style error is well below it.
    pub nearest_other: f64,
    /// The scene in its style.
    pub stylized: Measures,
    /// The scene recolored to its colors.
    pub recolored: Measures,
}

impl Evaluation {
    /// A table for people.
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<32} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} {:>10} {:>8}\n",
            "painting", "nearest", "texture", "rank", "style", "content", "nnfm3_1", "recolored", "other"
        );
        for row in &self.paintings {
            let name = row.path.file_name().unwrap_or_default().to_string_lossy();
            text += &format!(
                "{:<32} {:>7.0}% {:>7.0}% {:>8.2} {:>8.3} {:>8.3} {:>8} {:>10.3} {:>8.3}\n",
                name.chars().take(32).collect::<String>(),
                100.0 * row.stylized.own_painting_nearest,
                100.0 * row.stylized.texture_own_painting_nearest,
                row.stylized.texture_rank,
                row.stylized.style_error,
                row.stylized.content_error,
                or_dash(row.stylized.nearest_feature_distances[1]),
                row.recolored.style_error,
                row.nearest_other,
            );
        }
        text += &format!(
            "\n{:<10} {:>8} {:>8} {:>8}   {:<22} {:>8} {:>7} {:>8} {:>8} {:>7}\n",
            "mean",
            "nearest",
            "style",
            "content",
            "relu1_1, 2_1, 3_1 (4_1)",
            "texture",
            "rank",
            "nnfm2_1",
            "nnfm3_1",
            "grain"
        );
        let kinds =
            [("stylized", Some(self.stylized)), ("mesh", self.mesh), ("unstyled", Some(self.unstyled))];
        let references = [("recolored", Some(self.recolored)), ("2D AdaIN", self.adain_2d)];
        for (name, measures) in kinds.into_iter().chain(references) {
            let Some(found) = measures else { continue };
            text += &found.line(name);
        }
        text += &format!(
            "\n{:<12} {:>9} {:>9} {:>9} {:>12} {:>9} {:>9}\n",
            "consistency", "short", "/ std", "vgg", "long", "/ std", "vgg"
        );
        let agreements =
            [("stylized", Some(self.consistency)), ("unstyled", Some(self.unstyled_consistency))];
        for (name, agreement) in agreements.into_iter().chain([("2D AdaIN", self.adain_2d_consistency)]) {
            let Some(Agreement { short, long }) = agreement else { continue };
            text += &format!(
                "{name:<12} {:>9.4} {:>9.4} {:>9.4} {:>12.4} {:>9.4} {:>9.4}\n",
                short.rmse,
                short.rmse_over_std_dev,
                short.vgg_distance,
                long.rmse,
                long.rmse_over_std_dev,
                long.vgg_distance
            );
        }
        text + &format!(
            "\nstyle error at relu2_1 and relu3_1 over that of recoloring: {:.3}; colors out of range: {:.1}%",
            self.deep_style_error_over_recolored,
            100.0 * self.out_of_range
        )
    }
}

/// A number for the table, or a dash.
fn or_dash(number: Option<f64>) -> String {
    number.map_or_else(|| "-".into(), |number| format!("{number:.3}"))
}

/// The mean, or `None` if there are none.
fn mean_of_some(numbers: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = numbers.fold((0.0, 0), |(sum, n), number| (sum + number, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}

impl Measures {
    fn line(&self, name: &str) -> String {
        let relu4_1 = self.relu4_1_style_error.map_or_else(String::new, |error| format!(" ({error:.3})"));
        format!(
            "{name:<10} {:>7.0}% {:>8.3} {:>8.3}   {:<23} {:>7.1}% {:>7.2} {:>8} {:>8} {:>7.3}\n",
            100.0 * self.own_painting_nearest,
            self.style_error,
            self.content_error,
            format!("{:.3?}{relu4_1}", self.style_errors),
            100.0 * self.texture_own_painting_nearest,
            self.texture_rank,
            or_dash(self.nearest_feature_distances[0]),
            or_dash(self.nearest_feature_distances[1]),
            self.grain,
        )
    }

    /// The mean of several, or 0 if there are none.
    pub fn mean(all: &[Self]) -> Self {
        let n = all.len().max(1) as f64;
        let mean = |part: &dyn Fn(&Self) -> f64| all.iter().map(part).sum::<f64>() / n;
        Self {
            own_painting_nearest: mean(&|measures| measures.own_painting_nearest),
            style_errors: [0, 1, 2].map(|layer| mean(&|measures| measures.style_errors[layer])),
            style_error: mean(&|measures| measures.style_error),
            relu4_1_style_error: all
                .iter()
                .map(|measures| measures.relu4_1_style_error)
                // `None` if any is: a mean over some pictures would not compare with the others.
                .sum::<Option<f64>>()
                .map(|sum| sum / n),
            texture_own_painting_nearest: mean(&|measures| measures.texture_own_painting_nearest),
            texture_rank: mean(&|measures| measures.texture_rank),
            texture_error: mean(&|measures| measures.texture_error),
            nearest_feature_distances: [0, 1]
                .map(|i| mean_of_some(all.iter().filter_map(|m| m.nearest_feature_distances[i]))),
            grain: mean(&|measures| measures.grain),
            content_error: mean(&|measures| measures.content_error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A view that sees nothing has no nearest features, and must not look like a perfect one.
    #[test]
    fn pictures_without_cells_do_not_count() {
        let of = |distances| Measures { nearest_feature_distances: distances, ..Measures::default() };
        let mean = Measures::mean(&[of([Some(0.2), None]), of([None, None]), of([Some(0.4), None])]);
        let [relu2_1, relu3_1] = mean.nearest_feature_distances;
        assert!((relu2_1.unwrap() - 0.3).abs() < 1e-12 && relu3_1.is_none());
        assert!(mean.line("a").contains("0.300        - "), "{}", mean.line("a"));
    }
}

//! Contact sheets: many pictures on one page, to compare paintings and views at a glance.

use glam::UVec2;

use crate::picture::Picture;

/// Space between pictures and around them, in pixels.
const GAP: u32 = 8;
/// Color of the page.
const PAPER: [u8; 4] = [255; 4];

/// Lays out rows of pictures, e.g. a painting and then the views in its style. Every picture is shrunk or
/// enlarged to fit a cell and centered in it. If a row has fewer pictures than others, it ends with empty
/// cells.
pub fn contact_sheet(rows: &[Vec<Picture>], cell: UVec2) -> Picture {
    let n_columns = rows.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let pitch = cell + GAP;
    let mut sheet = Picture::filled(pitch * UVec2::new(n_columns, rows.len() as u32) + GAP, PAPER);
    for (y, row) in rows.iter().enumerate() {
        for (x, picture) in row.iter().enumerate() {
            let fitted = fit(picture, cell);
            let corner = pitch * UVec2::new(x as u32, y as u32) + GAP + (cell - fitted.size) / 2;
            sheet.paste(&fitted, corner);
        }
    }
    sheet
}

/// The picture over the page, with its own proportions, as large as `cell` allows.
fn fit(picture: &Picture, cell: UVec2) -> Picture {
    let over_paper = picture.rgba.iter().flat_map(|&[r, g, b, a]| {
        [r, g, b].map(|channel| {
            let alpha = f32::from(a) / 255.0;
            (alpha * f32::from(channel) + (1.0 - alpha) * 255.0).round() as u8
        })
    });
    let whole =
        image::RgbImage::from_raw(picture.size.x, picture.size.y, over_paper.collect()).unwrap_or_default();
    let ratio = (cell.as_vec2() / picture.size.max(UVec2::ONE).as_vec2()).min_element();
    // A very thin picture keeps at least a pixel.
    let size = (picture.size.as_vec2() * ratio).round().as_uvec2().clamp(UVec2::ONE, cell);
    let scaled = image::imageops::resize(&whole, size.x, size.y, image::imageops::FilterType::Triangle);
    Picture { size, rgba: scaled.pixels().map(|pixel| [pixel[0], pixel[1], pixel[2], 255]).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_stand_in_their_cells() {
        let red = Picture::filled(UVec2::new(20, 10), [255, 0, 0, 255]);
        let nothing = Picture::filled(UVec2::new(10, 10), [0; 4]);
        let sheet = contact_sheet(&[vec![red.clone(), nothing], vec![red]], UVec2::new(10, 10));
        assert_eq!(sheet.size, UVec2::new(8 + 2 * 18, 8 + 2 * 18));
        let at = |x: u32, y: u32| sheet.rgba[(y * sheet.size.x + x) as usize];
        // The first cell is 8..18: a picture of 10x5 from y = 10 to 14.
        assert_eq!(at(8, 10), [255, 0, 0, 255]);
        assert_eq!(at(17, 14), [255, 0, 0, 255]);
        assert_eq!(at(8, 9), PAPER);
        assert_eq!(at(18, 10), PAPER);
        // Transparency shows the paper; a missing picture too.
        assert_eq!(at(30, 12), PAPER);
        assert_eq!(at(30, 30), PAPER);
        assert_eq!(at(8, 28), [255, 0, 0, 255]);
    }

    #[test]
    fn an_empty_sheet_is_only_paper() {
        assert_eq!(contact_sheet(&[], UVec2::new(10, 10)).size, UVec2::splat(8));
    }
}

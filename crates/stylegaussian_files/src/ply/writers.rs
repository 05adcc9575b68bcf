//! The up direction that a .ply tells: by a comment, or by the habits of the program that names itself in it.
//!
//! The format has no field for it. Comments name an axis, and programs mean different ends of it.

use glam::Vec3;

/// A program that names itself in the comments of its files.
struct Writer {
    name: &'static str,
    /// Words by which its comments are known, in lower case.
    words: &'static [&'static str],
    /// The end of an axis that its comments mean by the axis' letter.
    end: End,
    /// The up direction of its files if no comment tells one, and the reason.
    up: Option<(Vec3, &'static str)>,
}

/// The end of an axis that is up if a comment names the axis.
#[derive(Clone, Copy)]
enum End {
    /// The letter is the direction: `z` is +z.
    Positive,
    /// The letter is an axis of 3DGS, whose y and z point down and away: `y` is -y.
    Of3dgs,
}

/// Programs whose files say who wrote them. Polycam, Scaniverse, Luma and RealityScan write headers without a
/// comment: nothing tells their files from others.
const WRITERS: [Writer; 4] = [
    Writer {
        name: "nerfstudio",
        // Its exporter spells itself without the f.
        words: &["nerfstudio", "nerstudio"],
        end: End::Positive,
        up: Some((Vec3::Z, "nerfstudio turns its scenes so that +z is up")),
    },
    // `Exported from Brush`, and `Vertical axis: y` for the -y of 3DGS.
    Writer { name: "Brush", words: &["brush"], end: End::Of3dgs, up: None },
    Writer {
        name: "SuperSplat",
        words: &["supersplat", "super-splat"],
        end: End::Of3dgs,
        up: Some((Vec3::NEG_Y, "SuperSplat shows and saves scenes with -y up")),
    },
    // Scenes of Postshot keep the coordinates of COLMAP or of its user.
    Writer { name: "Postshot", words: &["postshot", "jawset"], end: End::Of3dgs, up: None },
];

/// The up direction that the comments of a header tell, and the reason, as a clause. Comments may say
/// anything, so one that does not parse is no error.
pub(super) fn up(comments: &[String]) -> Option<(Vec3, String)> {
    let writer = WRITERS.iter().find(|writer| comments.iter().any(|comment| writer.is_named_in(comment)));
    let told = |comment: &String| told(comment, writer);
    let by_habit = || {
        let (up, because) = writer?.up?;
        Some((up, because.to_owned()))
    };
    comments.iter().find_map(told).or_else(by_habit)
}

impl Writer {
    fn is_named_in(&self, comment: &str) -> bool {
        let is_part = |c: char| c.is_alphanumeric() || c == '-';
        comment
            .split(|c| !is_part(c))
            .any(|word| self.words.iter().any(|mark| word.eq_ignore_ascii_case(mark)))
    }
}

/// The up direction of `up X Y Z`, as our files have it, or of `Vertical axis:`, an axis or a direction.
fn told(comment: &str, writer: Option<&Writer>) -> Option<(Vec3, String)> {
    // Some have no space after the colon.
    let spaced = comment.replace(':', ": ");
    let words: Vec<&str> = spaced.split_ascii_whitespace().collect();
    let lower: Vec<String> = words.iter().map(|word| word.to_lowercase()).collect();
    let lower: Vec<&str> = lower.iter().map(String::as_str).collect();
    let direction = |xyz: [&str; 3]| {
        let [x, y, z] = xyz.map(|word| word.parse().ok());
        // `None` for zero and for NaN.
        Vec3::new(x?, y?, z?).try_normalize()
    };
    let shown = comment.trim().escape_debug();
    match lower[..] {
        ["up", x, y, z] | ["vertical", "axis:", x, y, z] => {
            Some((direction([x, y, z])?, format!("the comment `{shown}` says so")))
        }
        ["vertical", "axis:", axis] => {
            // Without a writer's name the spelling tells: `Vertical Axis` is nerfstudio's, `Vertical axis`
            // Brush's.
            let by_spelling = if words[1].starts_with('A') { End::Positive } else { End::Of3dgs };
            let end = writer.map_or(by_spelling, |writer| writer.end);
            let (up, sense) = axis_from_text(axis, end)?;
            let whose = writer.map_or("this spelling", |writer| writer.name);
            Some((up, format!("the comment `{shown}` names the axis, and {whose} means {sense}")))
        }
        _ => None,
    }
}

/// The direction of `x`, `y` or `z`, and its name. A sign before the letter counts, whoever wrote it.
fn axis_from_text(text: &str, end: End) -> Option<(Vec3, &'static str)> {
    let (letter, is_negative) = match (text.strip_prefix('-'), text.strip_prefix('+'), end) {
        (Some(letter), ..) => (letter, true),
        (_, Some(letter), _) => (letter, false),
        (None, None, End::Positive) => (text, false),
        (None, None, End::Of3dgs) => (text, text != "x"),
    };
    Some(match (letter, is_negative) {
        ("x", false) => (Vec3::X, "+x"),
        ("y", false) => (Vec3::Y, "+y"),
        ("z", false) => (Vec3::Z, "+z"),
        ("x", true) => (Vec3::NEG_X, "-x"),
        ("y", true) => (Vec3::NEG_Y, "-y"),
        ("z", true) => (Vec3::NEG_Z, "-z"),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn up_of(comments: &[&str]) -> Option<Vec3> {
        let comments: Vec<String> = comments.iter().map(|&comment| comment.into()).collect();
        up(&comments).map(|(up, _)| up)
    }

    #[test]
    fn a_letter_means_what_its_writer_means() {
        for (comments, expected) in [
            // nerfstudio 1.1.5, and as it should be spelled.
            (&["Generated by Nerstudio 1.1.5", "Vertical Axis: z"][..], Vec3::Z),
            (&["Generated by Nerfstudio 1.1.3", "Vertical Axis: z"], Vec3::Z),
            (&["Vertical Axis: z", "generated by nerfstudio"], Vec3::Z),
            (&["Generated by Nerfstudio", "Vertical axis: y"], Vec3::Y),
            (&["Generated by Nerfstudio", "Vertical Axis:y"], Vec3::Y),
            (&["Exported from Brush", "Vertical axis:0 0 -1"], Vec3::NEG_Z),
            (&["Generated by Nerstudio 1.1.5"], Vec3::Z),
            (&["Vertical Axis: z"], Vec3::Z),
            (&["Vertical Axis: y"], Vec3::Y),
            (&["Exported from Brush", "Vertical axis: y"], Vec3::NEG_Y),
            (&["Exported from Brush", "Vertical Axis: z"], Vec3::NEG_Z),
            (&["Exported from Brush", "Vertical axis: x"], Vec3::X),
            (&["Vertical axis: z"], Vec3::NEG_Z),
            (&["Generated by SuperSplat 2.7.1"], Vec3::NEG_Y),
            (&["Generated by SuperSplat 1.0", "Vertical Axis: y"], Vec3::NEG_Y),
            (&["Generated by Nerfstudio", "Vertical Axis: -z"], Vec3::NEG_Z),
            (&["Exported from Brush", "Vertical axis: +y"], Vec3::Y),
            // Ours, whoever wrote the rest.
            (&["Generated by Nerfstudio", "up 0 -2 0"], Vec3::NEG_Y),
        ] {
            assert_eq!(up_of(comments), Some(expected), "{comments:?}");
        }
        for nothing in ["made with an airbrush", "Exported from Brush", "Postshot 0.5", "Vertical Axis: up"] {
            assert_eq!(up_of(&[nothing]), None, "{nothing}");
        }
    }

    #[test]
    fn the_reason_names_the_comment_and_the_writer() {
        let (_, because) = up(&["Generated by Nerstudio 1".into(), "Vertical Axis: z".into()]).unwrap();
        assert_eq!(because, "the comment `Vertical Axis: z` names the axis, and nerfstudio means +z");
    }
}

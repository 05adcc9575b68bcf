//! The figures as a table, and as JSON.

/// Named figures, in order.
#[derive(Default)]
pub struct Report(Vec<(&'static str, f64, &'static str)>);

impl Report {
    /// Adds a figure and its unit. One that is not finite was not measured.
    pub fn add(&mut self, name: &'static str, value: f64, unit: &'static str) {
        self.0.push((name, value, unit));
    }

    /// A line for each figure.
    pub fn table(&self) -> String {
        let mut table = String::new();
        for (name, value, unit) in &self.0 {
            let value = if value.is_finite() { number(*value) } else { "-".into() };
            let line = format!("{name:<58} {value:>14} {unit}");
            table.push_str(line.trim_end());
            table.push('\n');
        }
        table
    }

    /// An object with a number for each name, or null if it was not measured.
    pub fn json(&self) -> String {
        // What is not finite becomes null.
        let figures =
            self.0.iter().map(|(name, value, _)| ((*name).to_owned(), serde_json::Value::from(*value)));
        let object: serde_json::Map<String, serde_json::Value> = figures.collect();
        format!("{:#}\n", serde_json::Value::Object(object))
    }
}

/// A number with three digits after the point, unless it is whole.
fn number(value: f64) -> String {
    if value.fract() == 0.0 { format!("{value:.0}") } else { format!("{value:.3}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_told_twice() {
        let mut report = Report::default();
        report.add("frames", 600.0, "");
        report.add("a frame", 1.23456, "ms");
        report.add("popping", f64::NAN, "");
        let table = report.table();
        let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split_whitespace().collect()).collect();
        assert_eq!(lines, [vec!["frames", "600"], vec!["a", "frame", "1.235", "ms"], vec!["popping", "-"]]);
        let json: serde_json::Value = serde_json::from_str(&report.json()).unwrap();
        assert_eq!((json["frames"].as_f64(), json["a frame"].as_f64()), (Some(600.0), Some(1.23456)));
        assert!(json["popping"].is_null() && json.as_object().unwrap().len() == 3);
    }
}

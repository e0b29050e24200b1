//! Reports: the rows of a study's results, as a table, as JSON `{"rows": [...]}`, as CSV, and as [`plot`]s.

#[cfg(feature = "plot")]
mod draw;
pub mod plot;

use serde_json::{Map, Value, json};

/// A value in a row of a report.
#[derive(Debug, Clone, PartialEq)]
pub enum ReportCell {
    /// A name.
    Text(String),
    /// A whole number.
    Count(u64),
    /// A measurement; tables show four significant digits.
    Number(f64),
    /// Yes or no.
    Flag(bool),
    /// No value: blank in tables and CSV, null in JSON.
    None,
}

impl From<&str> for ReportCell {
    fn from(text: &str) -> ReportCell {
        ReportCell::Text(text.to_owned())
    }
}

impl From<u64> for ReportCell {
    fn from(count: u64) -> ReportCell {
        ReportCell::Count(count)
    }
}

impl From<f64> for ReportCell {
    fn from(number: f64) -> ReportCell {
        if number.is_finite() { ReportCell::Number(number) } else { ReportCell::None }
    }
}

impl From<bool> for ReportCell {
    fn from(flag: bool) -> ReportCell {
        ReportCell::Flag(flag)
    }
}

impl<T: Into<ReportCell>> From<Option<T>> for ReportCell {
    fn from(cell: Option<T>) -> ReportCell {
        cell.map_or(ReportCell::None, Into::into)
    }
}

impl ReportCell {
    /// Formats the value as tables show it.
    fn shown(&self) -> String {
        match self {
            ReportCell::Text(text) => text.clone(),
            ReportCell::Count(count) => grouped(*count),
            ReportCell::Number(number) => significant(*number),
            ReportCell::Flag(flag) => if *flag { "yes" } else { "no" }.to_owned(),
            ReportCell::None => String::new(),
        }
    }

    fn value(&self) -> Value {
        match self {
            ReportCell::Text(text) => json!(text),
            ReportCell::Count(count) => json!(count),
            ReportCell::Number(number) => json!(number),
            ReportCell::Flag(flag) => json!(flag),
            ReportCell::None => Value::Null,
        }
    }

    fn comma_separated(&self) -> String {
        match self {
            ReportCell::Text(text) if text.contains([',', '"', '\n', '\r']) => {
                format!("\"{}\"", text.replace('"', "\"\""))
            }
            ReportCell::Text(text) => text.clone(),
            ReportCell::Count(count) => count.to_string(),
            ReportCell::Number(number) => number.to_string(),
            ReportCell::Flag(flag) => flag.to_string(),
            ReportCell::None => String::new(),
        }
    }
}

/// Formats a count with commas between thousands: 1234567 as 1,234,567.
fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut out = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Formats a number with four significant digits and no exponent; all digits before the point are kept.
fn significant(number: f64) -> String {
    if number == 0.0 {
        return "0".to_owned();
    }
    let mut digits = 3;
    let mut size = number.abs();
    while digits > 0 && size >= 10.0 {
        (digits, size) = (digits - 1, size / 10.0);
    }
    while digits < 12 && size > 0.0 && size < 1.0 {
        (digits, size) = (digits + 1, size * 10.0);
    }
    format!("{number:.digits$}")
}

/// The results of a study: rows of named columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Names of the columns: keys of JSON rows, and headings of tables and CSV.
    columns: Vec<&'static str>,
    rows: Vec<Vec<ReportCell>>,
}

impl Report {
    /// Returns a report with these columns and no rows.
    pub fn new(columns: &[&'static str]) -> Report {
        Report { columns: columns.to_vec(), rows: Vec::new() }
    }

    /// Appends a row.
    ///
    /// # Panics
    /// If the number of cells is not the number of columns.
    pub fn push(&mut self, row: Vec<ReportCell>) {
        assert_eq!(row.len(), self.columns.len(), "a cell for each of {:?}", self.columns);
        self.rows.push(row);
    }

    /// Formats a table with aligned columns; `shown` names the columns to show, or is empty to show all.
    pub fn table(&self, shown: &[&str]) -> String {
        let indices: Vec<usize> =
            (0..self.columns.len()).filter(|&i| shown.is_empty() || shown.contains(&self.columns[i])).collect();
        let mut lines: Vec<Vec<String>> = vec![indices.iter().map(|&i| self.columns[i].replace('_', " ")).collect()];
        lines.extend(self.rows.iter().map(|row| indices.iter().map(|&i| row[i].shown()).collect()));
        let widths: Vec<usize> =
            (0..indices.len()).map(|i| lines.iter().map(|line| line[i].chars().count()).max().unwrap_or(0)).collect();
        let is_text = |&i: &usize| self.rows.iter().any(|row| matches!(row[i], ReportCell::Text(_)));
        let left: Vec<bool> = indices.iter().map(is_text).collect();
        let mut out = String::new();
        for line in &lines {
            let cells: Vec<String> = (0..indices.len())
                .map(|i| {
                    if left[i] { format!("{:<1$}", line[i], widths[i]) } else { format!("{:>1$}", line[i], widths[i]) }
                })
                .collect();
            out.push_str(cells.join("  ").trim_end());
            out.push('\n');
        }
        out
    }

    /// Returns `{"rows": [...]}` with one object per row.
    pub fn json(&self) -> Value {
        let row = |row: &Vec<ReportCell>| {
            let pairs = self.columns.iter().zip(row).map(|(column, cell)| ((*column).to_owned(), cell.value()));
            Value::Object(pairs.collect::<Map<_, _>>())
        };
        json!({ "rows": self.rows.iter().map(row).collect::<Vec<_>>() })
    }

    /// Formats the rows as comma-separated values, after a line of headings.
    pub fn csv(&self) -> String {
        let mut out = self.columns.join(",");
        out.push('\n');
        for row in &self.rows {
            out.push_str(&row.iter().map(ReportCell::comma_separated).collect::<Vec<_>>().join(","));
            out.push('\n');
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_reads_the_same_in_all_three_forms() {
        let mut report = Report::new(&["set", "bytes", "ns_per_visible", "displaying"]);
        report.push(vec!["frog, whole".into(), 1_234_567u64.into(), 0.012_345.into(), true.into()]);
        report.push(vec!["noise".into(), ReportCell::None, f64::NAN.into(), false.into()]);
        assert_eq!(
            report.table(&[]),
            "set              bytes  ns per visible  displaying\n\
             frog, whole  1,234,567         0.01235         yes\n\
             noise                                           no\n"
        );
        assert_eq!(
            report.csv(),
            "set,bytes,ns_per_visible,displaying\n\"frog, whole\",1234567,0.012345,true\nnoise,,,false\n"
        );
        assert_eq!(report.json()["rows"][1]["ns_per_visible"], Value::Null);
        assert_eq!(report.json()["rows"][0]["bytes"], json!(1_234_567));
    }
}

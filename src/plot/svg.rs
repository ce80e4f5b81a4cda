//! Plots as SVG: axes with round ticks and units, points with a `<title>` each (shown on hover and
//! by the page's arrow keys), lines, and a colour bar. Text and axes have the page's colour
//! (`currentColor`), for light and dark themes.

use std::fmt::Write as _;

use super::ramp::{Ramp, css};

/// Escapes text for HTML and SVG, including attribute values.
pub fn escape_markup(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            // Control characters are not valid XML.
            c if c.is_control() && c != '\n' && c != '\t' => safe.push('\u{fffd}'),
            c => safe.push(c),
        }
    }
    safe
}

/// An axis; values decrease along it where `from` is larger than `to`.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// quantity and unit
    pub label: String,
    /// value at the left or lower end
    pub from: f64,
    /// value at the other end
    pub to: f64,
}

impl Axis {
    /// An axis that contains all finite values, with a margin of 5 %.
    pub fn fitting(label: &str, values: impl Iterator<Item = f64>) -> Self {
        let (min, max) = values
            .filter(|v| v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let (min, max) = if min <= max { (min, max) } else { (0.0, 1.0) };
        let margin = ((max - min) * 0.05).max(1e-3 * max.abs()).max(1e-9);
        Self { label: label.into(), from: min - margin, to: max + margin }
    }

    /// Position of a value, 0 to 1 from end to end.
    fn position(&self, value: f64) -> f64 {
        (value - self.from) / (self.to - self.from)
    }
}

/// About `count` round values within an interval, with their labels.
pub fn ticks(from: f64, to: f64, count: usize) -> Vec<(f64, String)> {
    let span = to - from;
    if !span.is_finite() || span <= 0.0 {
        return Vec::new();
    }
    let rough = span / count.max(1) as f64;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|s| *s >= rough * 0.999)
        .unwrap_or(rough);
    let digits = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (from / step).ceil() as i64;
    // Avoids a label of negative zero.
    let at = |k: i64| if k == 0 { 0.0 } else { k as f64 * step };
    (first..=first + 2 * count as i64 + 2)
        .map(at)
        .take_while(|v| *v <= to + step * 1e-9)
        .map(|v| (v, format!("{v:.digits$}")))
        .collect()
}

/// Marker of a point; bands differ in marker and colour, for colour blindness.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// circle
    Dot,
    /// of 6.4 SVG units
    Square,
    /// of 7.2 SVG units
    Triangle,
}

/// Margins around the plotting area (SVG units).
const LEFT: f64 = 64.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 48.0;
const RIGHT: f64 = 14.0;
/// Width of the colour bar with its labels (SVG units).
const BAR: f64 = 92.0;

/// A plot; elements are added one by one.
#[derive(Clone, Debug)]
pub struct Plot {
    description: String,
    x: Axis,
    y: Axis,
    /// size of the plotting area (SVG units)
    field: (f64, f64),
    inside: String,
    legend: Vec<(String, Shape, String)>,
    bar: Option<(Ramp, Axis)>,
}

impl Plot {
    /// A plot with a plotting area of size `field` (SVG units); `description` is its accessible
    /// name.
    pub fn new(description: &str, x: Axis, y: Axis, field: (f64, f64)) -> Self {
        Self {
            description: description.into(),
            x,
            y,
            field,
            inside: String::new(),
            legend: Vec::new(),
            bar: None,
        }
    }

    /// A plot of the standard size.
    pub fn standard(description: &str, x: Axis, y: Axis) -> Self {
        Self::new(description, x, y, (450.0, 280.0))
    }

    /// Adds a colour bar.
    pub fn with_bar(mut self, ramp: Ramp, axis: Axis) -> Self {
        self.bar = Some((ramp, axis));
        self
    }

    /// Adds a legend entry; `class` gives the colour.
    pub fn legend(&mut self, class: &str, shape: Shape, text: &str) {
        self.legend.push((class.into(), shape, text.into()));
    }

    /// SVG coordinates of a point.
    fn to_svg(&self, x: f64, y: f64) -> (f64, f64) {
        (LEFT + self.x.position(x) * self.field.0, TOP + (1.0 - self.y.position(y)) * self.field.1)
    }

    /// A point with a tooltip; `class` gives the colour.
    pub fn point(&mut self, class: &str, shape: Shape, (x, y): (f64, f64), tooltip: &str) {
        if x.is_finite() && y.is_finite() {
            let mark =
                mark(shape, self.to_svg(x, y), &format!("class=\"m {class}\""), Some(tooltip));
            self.inside.push_str(&mark);
        }
    }

    /// A point with a tooltip, coloured by value.
    pub fn colored_point(&mut self, (x, y): (f64, f64), value: f64, tooltip: &str) {
        if let Some((ramp, axis)) = &self.bar
            && x.is_finite()
            && y.is_finite()
        {
            let style = if value.is_finite() {
                format!("class=\"m\" fill=\"{}\"", css(ramp.at(axis.position(value))))
            } else {
                "class=\"m none\"".into()
            };
            let mark = mark(Shape::Dot, self.to_svg(x, y), &style, Some(tooltip));
            self.inside.push_str(&mark);
        }
    }

    /// A line through points, interrupted where one is not finite.
    pub fn line(&mut self, class: &str, points: &[(f64, f64)]) {
        for segment in
            points.split(|(x, y)| !x.is_finite() || !y.is_finite()).filter(|s| s.len() > 1)
        {
            let points: Vec<String> = segment
                .iter()
                .map(|(x, y)| self.to_svg(*x, *y))
                .map(|(x, y)| format!("{x:.1},{y:.1}"))
                .collect();
            let _infallible = write!(
                self.inside,
                "<polyline class=\"l {class}\" points=\"{}\"/>",
                points.join(" ")
            );
        }
    }

    /// A rectangle between two opposite corners, coloured by value, with a tooltip; not drawn for
    /// `None`.
    pub fn cell(
        &mut self,
        (x0, y0): (f64, f64),
        (x1, y1): (f64, f64),
        value: Option<f64>,
        tooltip: &str,
    ) {
        let ((a, b), (c, d)) = (self.to_svg(x0, y0), self.to_svg(x1, y1));
        let ((a, b), (c, d)) = ((a.min(c), b.min(d)), (a.max(c), b.max(d)));
        // Slightly larger, so that no gap shows between neighbours.
        let (width, height) = (c - a + 0.4, d - b + 0.4);
        let style = match (&self.bar, value) {
            (Some((ramp, axis)), Some(v)) => {
                format!("class=\"m c\" fill=\"{}\"", css(ramp.at(axis.position(v))))
            }
            _ => return,
        };
        let _infallible = write!(
            self.inside,
            "<rect {style} x=\"{a:.1}\" y=\"{b:.1}\" width=\"{width:.1}\" \
             height=\"{height:.1}\"><title>{}</title></rect>",
            escape_markup(tooltip)
        );
    }

    /// Shades the area between two values of x.
    pub fn shade(&mut self, from: f64, to: f64) {
        let clamped = |v: f64| v.clamp(self.x.from, self.x.to);
        let ((a, top), (b, bottom)) =
            (self.to_svg(clamped(from), self.y.to), self.to_svg(clamped(to), self.y.from));
        let (width, height) = (b - a, bottom - top);
        let rect = format!(
            "<rect class=\"shade\" x=\"{a:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" \
             height=\"{height:.1}\"/>"
        );
        self.inside.insert_str(0, &rect);
    }

    /// Grid lines, ticks and labels of both axes.
    fn axes(&self) -> String {
        let ((fw, fh), mut out) = (self.field, String::new());
        let mut put = |text: String| out.push_str(&text);
        for (value, label) in
            ticks(self.x.from.min(self.x.to), self.x.from.max(self.x.to), (fw / 75.0) as usize)
        {
            let (x, y) = self.to_svg(value, self.y.from);
            put(format!(
                "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{TOP}\" y2=\"{y:.1}\"/>"
            ));
            put(format!(
                "<text class=\"tick\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                y + 18.0,
                minus(&label)
            ));
        }
        for (value, label) in
            ticks(self.y.from.min(self.y.to), self.y.from.max(self.y.to), (fh / 45.0) as usize)
        {
            let (x, y) = self.to_svg(self.x.from, value);
            put(format!(
                "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>",
                x + fw
            ));
            put(format!(
                "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                x - 7.0,
                y + 4.5,
                minus(&label)
            ));
        }
        put(format!(
            "<text class=\"label\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            LEFT + fw / 2.0,
            TOP + fh + 40.0,
            escape_markup(&self.x.label)
        ));
        let middle = TOP + fh / 2.0;
        put(format!(
            "<text class=\"label\" transform=\"translate(16 {middle:.1}) rotate(-90)\" \
             text-anchor=\"middle\">{}</text>",
            escape_markup(&self.y.label)
        ));
        out
    }

    /// The plot as an `<svg>` element. `id` must be unique within the page.
    pub fn into_svg(self, id: &str) -> String {
        let (fw, fh) = self.field;
        let legend_height = if self.legend.is_empty() {
            0.0
        } else {
            20.0 * self.legend.len().div_ceil(3) as f64 + 6.0
        };
        let width = LEFT + fw + RIGHT + if self.bar.is_some() { BAR } else { 0.0 };
        let height = TOP + fh + BOTTOM + legend_height;
        let mut out = format!(
            "<svg class=\"plot\" id=\"{id}\" viewBox=\"0 0 {width:.0} {height:.0}\" \
             style=\"max-width:{:.0}px\" tabindex=\"0\" role=\"group\" aria-label=\"{}\">",
            width * 1.3,
            escape_markup(&self.description)
        );
        let mut put = |text: String| out.push_str(&text);
        put(format!(
            "<rect class=\"field\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{fw:.1}\" height=\"{fh:.1}\"/>"
        ));
        put(self.axes());
        let bottom = TOP + fh;
        put(format!(
            "<clipPath id=\"{id}-f\"><rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" \
             height=\"{:.1}\"/></clipPath>",
            LEFT - 5.0,
            TOP - 5.0,
            fw + 10.0,
            fh + 10.0
        ));
        put(format!("<g clip-path=\"url(#{id}-f)\">{}</g>", self.inside));
        for (i, (class, shape, text)) in self.legend.iter().enumerate() {
            let (x, y) = (
                LEFT + (i % 3) as f64 * (fw / 3.0 + 8.0),
                bottom + BOTTOM + 12.0 + 20.0 * (i / 3) as f64,
            );
            put(mark(*shape, (x + 6.0, y - 4.5), &format!("class=\"{class}\""), None));
            put(format!(
                "<text class=\"tick\" x=\"{:.1}\" y=\"{y:.1}\">{}</text>",
                x + 16.0,
                escape_markup(text)
            ));
        }
        if let Some((ramp, axis)) = &self.bar {
            put(bar(*ramp, axis, LEFT + fw + 16.0, fh));
        }
        out.push_str("</svg>");
        out
    }
}

/// The colour bar with its ticks and label.
fn bar(ramp: Ramp, axis: &Axis, x: f64, height: f64) -> String {
    const STEPS: usize = 32;
    let mut out = String::new();
    let step = height / STEPS as f64;
    for i in 0..STEPS {
        let y = TOP + height - (i + 1) as f64 * step;
        let color = css(ramp.at((i as f64 + 0.5) / STEPS as f64));
        let _infallible = write!(
            out,
            "<rect fill=\"{color}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"14\" height=\"{:.1}\"/>",
            step + 0.4
        );
    }
    for (value, label) in ticks(axis.from, axis.to, 5) {
        let y = TOP + (1.0 - axis.position(value)) * height + 4.5;
        let _infallible = write!(
            out,
            "<text class=\"tick\" x=\"{:.1}\" y=\"{y:.1}\">{}</text>",
            x + 19.0,
            minus(&label)
        );
    }
    let middle = TOP + height / 2.0;
    let _infallible = write!(
        out,
        "<text class=\"label\" transform=\"translate({:.1} {middle:.1}) rotate(-90)\" \
         text-anchor=\"middle\">{}</text>",
        x + 74.0,
        escape_markup(&axis.label)
    );
    out
}

/// Replaces hyphens by minus signs.
fn minus(label: &str) -> String {
    label.replace('-', "−")
}

fn mark(shape: Shape, (x, y): (f64, f64), style: &str, tooltip: Option<&str>) -> String {
    let title =
        tooltip.map_or_else(String::new, |s| format!("<title>{}</title>", escape_markup(s)));
    match shape {
        Shape::Dot => {
            format!("<circle {style} cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.6\">{title}</circle>")
        }
        Shape::Square => format!(
            "<rect {style} x=\"{:.1}\" y=\"{:.1}\" width=\"6.4\" height=\"6.4\">{title}</rect>",
            x - 3.2,
            y - 3.2
        ),
        Shape::Triangle => {
            format!("<path {style} d=\"M{x:.1} {:.1}l4 7.2h-8z\">{title}</path>", y - 4.4)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within_the_axis() {
        let labels = |from, to| ticks(from, to, 5).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels(0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(-31.0, 42.0), ["-20", "0", "20", "40"]);
        assert_eq!(labels(1.61, 2.97), ["2.0", "2.5"]);
        assert_eq!(labels(-0.004, 0.011), ["0.000", "0.005", "0.010"]);
        assert!(labels(1.0, 1.0).is_empty() && labels(f64::NAN, 1.0).is_empty());
    }

    #[test]
    fn text_from_logs_is_escaped() {
        let mut plot = Plot::standard(
            "a \"plot\"",
            Axis::fitting("x [m]", [0.0, 1.0].into_iter()),
            Axis::fitting("<y>", [f64::NAN].into_iter()),
        );
        plot.point("r", Shape::Dot, (0.5, 0.5), "<script>alert('1')</script>\u{1}");
        plot.point("r", Shape::Dot, (f64::NAN, 0.5), "nowhere");
        let svg = plot.into_svg("p");
        assert!(
            !svg.contains("<script")
                && !svg.contains("<y>")
                && !svg.contains("nowhere")
                && !svg.contains('\u{1}'),
            "{svg}"
        );
        assert!(
            svg.contains("&lt;script&gt;alert(&#39;1&#39;)") && svg.contains("a &quot;plot&quot;")
        );
    }
}

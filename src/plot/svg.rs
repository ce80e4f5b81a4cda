//! One plot as SVG: axes with round ticks and units, points with a `<title>` each (hover, and the
//! page's arrow keys), lines, and a colour bar. Colours of words and axes are the page's
//! (`currentColor`), so it reads in light and dark.

use std::fmt::Write as _;

use super::ramp::{Ramp, css};

/// Text that is safe inside of HTML and SVG, attributes too.
pub fn escape_markup(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            // Control characters are no XML and would end in a parser's error.
            c if c.is_control() && c != '\n' && c != '\t' => safe.push('\u{fffd}'),
            c => safe.push(c),
        }
    }
    safe
}

/// An axis: what it says, with its unit, and its ends; values fall along it where `from` is the
/// larger.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// words under or beside it
    pub label: String,
    /// value at the left or lower end
    pub from: f64,
    /// value at the other end
    pub to: f64,
}

impl Axis {
    /// An axis that holds all finite values, with a little room.
    pub fn fitting(label: &str, values: impl Iterator<Item = f64>) -> Self {
        let (least, most) = values
            .filter(|v| v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), v| (l.min(v), m.max(v)));
        let (least, most) = if least <= most { (least, most) } else { (0.0, 1.0) };
        let room = ((most - least) * 0.05).max(1e-3 * most.abs()).max(1e-9);
        Self { label: label.into(), from: least - room, to: most + room }
    }

    /// The same, reaching down to a value at least.
    pub fn down_to(mut self, value: f64) -> Self {
        self.from = self.from.min(value);
        self
    }

    fn share(&self, value: f64) -> f64 {
        (value - self.from) / (self.to - self.from)
    }
}

/// Round values inside of an interval, about so many, with their words.
pub fn ticks(from: f64, to: f64, about: usize) -> Vec<(f64, String)> {
    let span = to - from;
    if !span.is_finite() || span <= 0.0 {
        return Vec::new();
    }
    let rough = span / about.max(1) as f64;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|s| *s >= rough * 0.999)
        .unwrap_or(rough);
    let digits = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (from / step).ceil() as i64;
    // A negative zero is a zero.
    let at = |k: i64| if k == 0 { 0.0 } else { k as f64 * step };
    (first..=first + 2 * about as i64 + 2)
        .map(at)
        .take_while(|v| *v <= to + step * 1e-9)
        .map(|v| (v, format!("{v:.digits$}")))
        .collect()
}

/// How a point looks; colour alone does not tell bands apart for everyone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// round
    Dot,
    /// square
    Square,
    /// triangle
    Triangle,
}

/// Room around the plot's field [SVG units].
const LEFT: f64 = 64.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 48.0;
const RIGHT: f64 = 14.0;
/// Room of a colour bar.
const BAR: f64 = 92.0;

/// A plot in the making.
#[derive(Clone, Debug)]
pub struct Plot {
    says: String,
    x: Axis,
    y: Axis,
    field: (f64, f64),
    inside: String,
    legend: Vec<(String, Shape, String)>,
    bar: Option<(Ramp, Axis)>,
}

impl Plot {
    /// A plot whose field has a size [SVG units]; `says` is for who cannot see it.
    pub fn new(says: &str, x: Axis, y: Axis, field: (f64, f64)) -> Self {
        Self {
            says: says.into(),
            x,
            y,
            field,
            inside: String::new(),
            legend: Vec::new(),
            bar: None,
        }
    }

    /// A plot of the usual size.
    pub fn standard(says: &str, x: Axis, y: Axis) -> Self {
        Self::new(says, x, y, (450.0, 280.0))
    }

    /// Adds a colour bar.
    pub fn with_bar(mut self, ramp: Ramp, axis: Axis) -> Self {
        self.bar = Some((ramp, axis));
        self
    }

    /// Adds a line to the legend.
    pub fn legend(&mut self, class: &str, shape: Shape, text: &str) {
        self.legend.push((class.into(), shape, text.into()));
    }

    fn place(&self, x: f64, y: f64) -> (f64, f64) {
        (LEFT + self.x.share(x) * self.field.0, TOP + (1.0 - self.y.share(y)) * self.field.1)
    }

    /// A point that says something. `class` gives its colour.
    pub fn point(&mut self, class: &str, shape: Shape, (x, y): (f64, f64), says: &str) {
        if x.is_finite() && y.is_finite() {
            let mark = mark(shape, self.place(x, y), &format!("class=\"m {class}\""), Some(says));
            self.inside.push_str(&mark);
        }
    }

    /// A point in the colour of the bar's value.
    pub fn colored_point(&mut self, (x, y): (f64, f64), value: f64, says: &str) {
        if let Some((ramp, axis)) = &self.bar
            && x.is_finite()
            && y.is_finite()
        {
            let style = if value.is_finite() {
                format!("class=\"m\" fill=\"{}\"", css(ramp.at(axis.share(value))))
            } else {
                "class=\"m none\"".into()
            };
            let mark = mark(Shape::Dot, self.place(x, y), &style, Some(says));
            self.inside.push_str(&mark);
        }
    }

    /// A line through points; it breaks where one is not finite.
    pub fn line(&mut self, class: &str, points: &[(f64, f64)]) {
        for stretch in
            points.split(|(x, y)| !x.is_finite() || !y.is_finite()).filter(|s| s.len() > 1)
        {
            let places: Vec<String> = stretch
                .iter()
                .map(|(x, y)| self.place(*x, *y))
                .map(|(x, y)| format!("{x:.1},{y:.1}"))
                .collect();
            let _infallible = write!(
                self.inside,
                "<polyline class=\"l {class}\" points=\"{}\"/>",
                places.join(" ")
            );
        }
    }

    /// A field of values: a rectangle with two opposite corners, in the bar's colour; `None` is
    /// masked.
    pub fn cell(
        &mut self,
        (x0, y0): (f64, f64),
        (x1, y1): (f64, f64),
        value: Option<f64>,
        says: &str,
    ) {
        let ((a, b), (c, d)) = (self.place(x0, y0), self.place(x1, y1));
        let ((a, b), (c, d)) = ((a.min(c), b.min(d)), (a.max(c), b.max(d)));
        // A hair wider, or the page shines through between neighbours.
        let (width, height) = (c - a + 0.4, d - b + 0.4);
        let style = match (&self.bar, value) {
            (Some((ramp, axis)), Some(v)) => {
                format!("class=\"m c\" fill=\"{}\"", css(ramp.at(axis.share(v))))
            }
            _ => return,
        };
        let _infallible = write!(
            self.inside,
            "<rect {style} x=\"{a:.1}\" y=\"{b:.1}\" width=\"{width:.1}\" \
             height=\"{height:.1}\"><title>{}</title></rect>",
            escape_markup(says)
        );
    }

    /// Shades the field between two values of x.
    pub fn shade(&mut self, from: f64, to: f64) {
        let held = |v: f64| v.clamp(self.x.from, self.x.to);
        let ((a, top), (b, bottom)) =
            (self.place(held(from), self.y.to), self.place(held(to), self.y.from));
        let (width, height) = (b - a, bottom - top);
        let rect = format!(
            "<rect class=\"shade\" x=\"{a:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" \
             height=\"{height:.1}\"/>"
        );
        self.inside.insert_str(0, &rect);
    }

    /// The whole as an `<svg>` element. Its `id` names the clip path and must be one of its own in
    /// the page.
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
            escape_markup(&self.says)
        );
        let mut put = |text: String| out.push_str(&text);
        put(format!(
            "<rect class=\"field\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{fw:.1}\" height=\"{fh:.1}\"/>"
        ));
        for (value, word) in
            ticks(self.x.from.min(self.x.to), self.x.from.max(self.x.to), (fw / 75.0) as usize)
        {
            let (x, y) = self.place(value, self.y.from);
            put(format!(
                "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{TOP}\" y2=\"{y:.1}\"/>"
            ));
            put(format!(
                "<text class=\"tick\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                y + 18.0,
                minus(&word)
            ));
        }
        for (value, word) in
            ticks(self.y.from.min(self.y.to), self.y.from.max(self.y.to), (fh / 45.0) as usize)
        {
            let (x, y) = self.place(self.x.from, value);
            put(format!(
                "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>",
                x + fw
            ));
            put(format!(
                "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                x - 7.0,
                y + 4.5,
                minus(&word)
            ));
        }
        let bottom = TOP + fh;
        put(format!(
            "<text class=\"label\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            LEFT + fw / 2.0,
            bottom + 40.0,
            escape_markup(&self.x.label)
        ));
        let middle = TOP + fh / 2.0;
        put(format!(
            "<text class=\"label\" transform=\"translate(16 {middle:.1}) rotate(-90)\" \
             text-anchor=\"middle\">{}</text>",
            escape_markup(&self.y.label)
        ));
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

/// Thirty-two steps of a ramp with their values.
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
    for (value, word) in ticks(axis.from, axis.to, 5) {
        let y = TOP + (1.0 - axis.share(value)) * height + 4.5;
        let _infallible = write!(
            out,
            "<text class=\"tick\" x=\"{:.1}\" y=\"{y:.1}\">{}</text>",
            x + 19.0,
            minus(&word)
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

/// A typographic minus.
fn minus(word: &str) -> String {
    word.replace('-', "−")
}

fn mark(shape: Shape, (x, y): (f64, f64), style: &str, says: Option<&str>) -> String {
    let title = says.map_or_else(String::new, |s| format!("<title>{}</title>", escape_markup(s)));
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
    fn ticks_are_round_and_inside() {
        let words = |from, to| ticks(from, to, 5).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(words(0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(words(-31.0, 42.0), ["-20", "0", "20", "40"]);
        assert_eq!(words(1.61, 2.97), ["2.0", "2.5"]);
        assert_eq!(words(-0.004, 0.011), ["0.000", "0.005", "0.010"]);
        assert!(words(1.0, 1.0).is_empty() && words(f64::NAN, 1.0).is_empty());
    }

    #[test]
    fn what_a_log_says_stays_text() {
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

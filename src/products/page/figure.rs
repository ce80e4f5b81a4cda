//! A figure of the page, and what several figures use.

use crate::image::LinearImage;
use crate::plot::escape_markup;

/// Longest side of a shown image (px).
pub const SHOWN_SIDE: usize = 880;

/// A figure, or why there is none.
pub struct Figure {
    id: &'static str,
    title: String,
    /// HTML
    body: std::result::Result<String, String>,
    /// HTML
    caption: String,
}

impl Figure {
    /// A figure with its HTML, or the reason why there is none; the caption is HTML.
    pub fn of(
        id: &'static str,
        title: &str,
        body: std::result::Result<String, String>,
        caption: &str,
    ) -> Self {
        Self { id, title: title.into(), body, caption: caption.into() }
    }

    /// As HTML; `place` begins the ids of a camera's figures.
    pub fn html(&self, place: &str) -> String {
        let id = format!("{place}{}", self.id);
        match &self.body {
            Ok(body) => format!(
                "<figure id=\"{id}\" data-figure=\"{}\"><h3>{}</h3>{body}<output class=\"read\" \
                 aria-live=\"polite\"></output><figcaption>{}</figcaption></figure>\n",
                self.id,
                escape_markup(&self.title),
                self.caption
            ),
            Err(why) => format!(
                "<section id=\"{id}\" data-figure=\"{}\" class=\"missing\"><h3>{}</h3><p>Not \
                 shown: {}.</p></section>\n",
                self.id,
                escape_markup(&self.title),
                escape_markup(why)
            ),
        }
    }
}

/// Images and numbers of a frame that several figures use.
pub struct Seen {
    /// index of its record
    pub record: usize,
    pub altitude_m: f64,
    /// mean light per band of the raw image
    pub mean_light: [f64; 3],
    pub bands: usize,
    /// the raw image, downscaled; of the frames that are shown
    pub raw: Option<LinearImage>,
    /// Fig. 10, of one frame
    pub stages: Option<std::result::Result<String, String>>,
}

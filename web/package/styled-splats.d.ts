/** A captured scene in a painting's style: the custom element `<styled-splats>`. A page can have one. */
export declare class StyledSplats extends HTMLElement {
  /** Address of the scene, in any format that is one file, or of a world's `lod-meta.json` (streamed SOG). */
  src: string;
  /** Address of an image (JPEG or PNG); empty for the scene as it was captured. */
  painting: string;
  /** Share of the style's colors, 0 to 1. */
  strength: number;
  /**
   * `strokes` (default) lays on the painting's own strokes; `decoder` uses the paper's network, for which a
   * scene needs features.
   */
  method: "strokes" | "decoder";
  /** Factor of the strokes, 0 to 3: at 0, the painting's colors are left. 1 is the default, here and below. */
  paint: number;
  /** Factor of what stays clear of strokes, 0 to 10: at 0, nothing of the scene does. */
  protection: number;
  /** Factor of the size of strokes, 0.1 to 10. */
  strokeScale: number;
  /** The way in which styles arrive: `fade` (default), `sphere`, `front` or `noise`. */
  transition: "fade" | "sphere" | "front" | "noise";
  /** Time in which a style arrives. */
  seconds: number;
  /** Downloads the picture as a PNG. */
  savePicture(): void;
  /** Downloads the scene in the colors of the shown style, as a `.glb`. */
  saveGlb(): void;
  addEventListener<K extends keyof StyledSplatsEvents>(
    type: K,
    listener: (event: StyledSplatsEvents[K]) => void,
    options?: boolean | AddEventListenerOptions,
  ): void;
  addEventListener(
    type: string,
    listener: EventListenerOrEventListenerObject,
    options?: boolean | AddEventListenerOptions,
  ): void;
}

export interface StyledSplatsEvents {
  /** The app draws. */
  ready: CustomEvent<Record<string, never>>;
  /** Work that takes a while, and the share that is done, 0 to 1, if it is known. */
  progress: CustomEvent<{
    task: "loading" | "reading" | "encoding" | "painting" | "embedding";
    share: number | null;
  }>;
  /**
   * The scene was read. One without features is embedded first if the decoder is to paint it, and is then
   * loaded once more.
   */
  loaded: CustomEvent<{ gaussians: number; hasFeatures: boolean }>;
  /** The scene is drawn. */
  shown: CustomEvent<Record<string, never>>;
  /** The style is shown, after this time. */
  applied: CustomEvent<{ milliseconds: number }>;
  /** Something could not be done: a sentence. */
  failed: CustomEvent<{ message: string }>;
}

declare global {
  interface HTMLElementTagNameMap {
    "styled-splats": StyledSplats;
  }
}

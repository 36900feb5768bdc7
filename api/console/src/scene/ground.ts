// The map on the ground, where one is configured: tiles around where the camera looks, finer ones over coarser ones.
// What is not there, or not there yet, is the plain ground under the grid.

import {
  BufferAttribute, BufferGeometry, Group, LinearFilter, LinearMipmapLinearFilter, Mesh, Texture, Vector2, type ShaderMaterial,
} from "three";

import type { Status } from "../state";
import { texts } from "../texts";
import { TileError, type LoadTile } from "../connection/tiles";
import { toScene } from "./axes";
import type { Eye, Shared } from "./camera";
import { material, ORDER } from "./materials";
import { addressOf, choose, placeAt, toShowFrame, type Origin, type Tile } from "./mercator";
import type { Overlay } from "./overlay";
import { TileCache } from "./tileCache";

const PARTS = 4; // of a tile's side: a square of the map is none of the ground

type Sheet = Mesh<BufferGeometry, ShaderMaterial>;

export class Ground {
  readonly group = new Group();
  readonly #shared;
  readonly #load;
  readonly #changed;
  readonly #view = { uFocus: { value: new Vector2() }, uReach: { value: 1 } };
  readonly #tile_cache = new TileCache<Sheet>((sheet) => this.#drop(sheet));
  #origin: Origin = { latitude_deg: 0, longitude_deg: 0, altitude_amsl_m: 0, heading_deg: 0 }; // for which sheets are laid out

  /** `changed` is called when there is something new to draw. */
  constructor(shared: Shared, load: LoadTile, changed: () => void) {
    this.#shared = shared;
    this.#load = load;
    this.#changed = changed;
  }

  /** No tile is requested while the camera moves. */
  draw(status: Status | null, eye: Eye, moves: boolean, now_ms: number, overlay: Overlay): void {
    for (const sheet of this.group.children) {
      sheet.visible = false;
    }
    if (status === null || status.map === null) {
      overlay.credit("", eye);
      return;
    }
    const { map, origin } = status;
    this.#lay(origin);
    const { focus, span_m } = eye.pose;
    const { tiles, reach_m } = choose(origin, -focus[2], focus[0], span_m / eye.screen.free.height, map);
    this.#view.uFocus.value.set(focus[0], focus[2]);
    this.#view.uReach.value = reach_m;
    const desired = new Map(tiles.map((tile) => [addressOf(tile, map.tiles), tile]));
    const addresses = [...desired.keys()];
    if (!moves) {
      this.#ask(this.#tile_cache.ask(addresses, now_ms), desired);
    }
    for (const [address, tile] of desired) {
      const sheet = this.#tile_cache.picture(address);
      if (sheet !== null) {
        sheet.visible = true;
        sheet.renderOrder = tile.zoom === tiles[0]!.zoom ? ORDER.farGround : ORDER.ground;
      }
    }
    overlay.credit(this.#stated(addresses, map.attribution), eye);
  }

  dispose(): void {
    this.#tile_cache.clear();
  }

  #lay(origin: Origin): void {
    if (JSON.stringify(origin) !== JSON.stringify(this.#origin)) {
      this.#origin = origin;
      this.#tile_cache.clear();
    }
  }

  #ask(due: readonly string[], desired: ReadonlyMap<string, Tile>): void {
    for (const address of due) {
      const tile = desired.get(address)!;
      void this.#load(address)
        .then(
          (picture) => this.#tile_cache.put(address, () => this.#sheet(tile, picture)),
          (error: unknown) => {
            if (!(error instanceof TileError)) throw error;
            this.#tile_cache.fail(address, { reason: error.message, isMissing: error.isMissing }, performance.now());
          },
        )
        .finally(this.#changed);
    }
  }

  /** Attribution of the shown tiles, and why others are missing. */
  #stated(addresses: readonly string[], attribution: string): string {
    const shown = addresses.filter((address) => this.#tile_cache.picture(address) !== null).length;
    const failures = addresses.map((address) => this.#tile_cache.failure(address)).filter((failure) => failure !== null);
    const broken = failures.find((failure) => !failure.isMissing);
    const words = shown > 0 ? [attribution] : [];
    if (broken !== undefined) words.push(texts.scene.mapIncomplete(broken.reason));
    else if (shown === 0 && failures.length > 0 && failures.length === addresses.length) words.push(texts.scene.mapElsewhere);
    return words.filter((each) => each !== "").join(" · ");
  }

  #sheet(tile: Tile, picture: ImageBitmap): Sheet {
    const texture = new Texture(picture);
    texture.flipY = false; // its first row is the north
    texture.minFilter = LinearMipmapLinearFilter;
    texture.magFilter = LinearFilter;
    texture.anisotropy = 4;
    texture.needsUpdate = true;
    const uniforms = { ...this.#shared, ...this.#view, uPicture: { value: texture } };
    const sheet = new Mesh(shapeOf(tile, this.#origin), material({ uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT, hidden: false }));
    sheet.frustumCulled = false;
    sheet.visible = false;
    this.group.add(sheet);
    return sheet;
  }

  #drop(sheet: Sheet): void {
    this.group.remove(sheet);
    const texture = sheet.material.uniforms["uPicture"]!.value as Texture<ImageBitmap>;
    texture.image.close();
    texture.dispose();
    sheet.geometry.dispose();
    sheet.material.dispose();
  }
}

/** A tile's ground, in a few parts; `uv` from its north-west. */
function shapeOf({ zoom, column, row }: Tile, origin: Origin): BufferGeometry {
  const corners: number[] = [];
  const at: number[] = [];
  const index: number[] = [];
  const side = PARTS + 1;
  for (let k = 0; k < side * side; k += 1) {
    const [u, v] = [(k % side) / PARTS, Math.floor(k / side) / PARTS];
    const { x_m, y_m } = toShowFrame(placeAt(column + u, row + v, zoom), origin);
    corners.push(...toScene(x_m, y_m, 0));
    at.push(u, v);
    if (u < 1 && v < 1) {
      index.push(k, k + 1, k + side, k + side, k + 1, k + side + 1);
    }
  }
  const shape = new BufferGeometry();
  shape.setAttribute("position", new BufferAttribute(new Float32Array(corners), 3));
  shape.setAttribute("uv", new BufferAttribute(new Float32Array(at), 2));
  shape.setIndex(index);
  return shape;
}

const VERTEX = /* glsl */ `
varying vec2 vAt;
varying vec2 vPlace;
void main() {
  vAt = uv;
  vPlace = position.xz;
  gl_Position = projectionMatrix * viewMatrix * vec4(position, 1.0);
}`;

// At night the map is dim and pale, so that lights stay what shines.
const FRAGMENT = /* glsl */ `
uniform sampler2D uPicture;
uniform float uNight;
uniform vec2 uFocus;
uniform float uReach;
varying vec2 vAt;
varying vec2 vPlace;
void main() {
  vec4 seen = texture2D(uPicture, vAt);
  vec3 pale = mix(vec3(dot(seen.rgb, vec3(0.3, 0.59, 0.11))), seen.rgb, mix(0.85, 0.65, uNight));
  float alpha = seen.a * (1.0 - smoothstep(0.5, 1.0, length(vPlace - uFocus) / uReach));
  gl_FragColor = vec4(pale * mix(1.0, 0.22, uNight) * alpha, alpha);
}`;

// Decodes the binary messages; the layouts are those of src/cohelm/station/view.py.

export type Pose = [number, number, number]

export interface MapPart {
  number: number
  origin: Pose
  resolution: number
  width: number
  height: number
  column: number
  row: number
  columns: number
  rows: number
  /** zlib */
  cells: Uint8Array<ArrayBuffer>
}

export interface Grid {
  number: number
  origin: Pose
  resolution: number
  width: number
  height: number
  /** As a picture, row 0 at the top. */
  picture: HTMLCanvasElement
  /** Counts up with every part that came. */
  version: number
}

export interface Scan {
  number: number
  /** Which of the robot's LiDARs; the first is 0. */
  lidar: number
  sensor: Pose
  first: number
  step: number
  ageMs: number
  /** When it came [ms, performance.now()]. */
  at: number
  /** [mm]; 65535 no return, 0 too near */
  ranges: Uint16Array
}

export interface Frame {
  number: number
  pose: Pose
  ageMs: number
  at: number
  jpeg: Uint8Array<ArrayBuffer>
}

export interface ZonePart {
  what: 'keep_out' | 'speed'
  origin: Pose
  resolution: number
  /** Speed that the cells' percentages refer to [m/s], or NaN. */
  usual: number
  columns: number
  rows: number
  /** zlib */
  cells: Uint8Array<ArrayBuffer>
}

export interface Zones {
  what: 'keep_out' | 'speed'
  origin: Pose
  resolution: number
  columns: number
  rows: number
  /** Row by row from below; 0: none. */
  cells: Uint8Array
  /** As a picture, row 0 at the top. */
  picture: HTMLCanvasElement
  /** Label of each speed zone, and its position in the map. */
  labels: Array<{ at: [number, number]; text: string }>
}

export type Binary = { zones: ZonePart } | { map: MapPart } | { scan: Scan } | { frame: Frame } | null

const MAP = 1
const SCAN = 2
const FRAME = 3
const ZONES = 4

export function decode(data: ArrayBuffer, now: number): Binary {
  const v = new DataView(data)
  const kind = v.getUint32(0, true)
  const number = v.getUint32(4, true)
  const f = (at: number) => v.getFloat64(at, true)
  const u = (at: number) => v.getUint32(at, true)
  const pose: Pose = [f(8), f(16), f(24)]
  if (kind === MAP) {
    return {
      map: {
        number, origin: pose, resolution: f(32), width: u(40), height: u(44),
        column: u(48), row: u(52), columns: u(56), rows: u(60), cells: new Uint8Array(data, 64),
      },
    }
  }
  if (kind === SCAN) {
    const ranges = new Uint16Array(data, 64, u(56))
    const [first, step, ageMs, lidar] = [f(32), f(40), f(48), u(60)]
    return { scan: { number, lidar, sensor: pose, first, step, ageMs, at: now, ranges } }
  }
  if (kind === FRAME) {
    return { frame: { number, pose, ageMs: f(32), at: now, jpeg: new Uint8Array(data, 40) } }
  }
  if (kind === ZONES) {
    return {
      zones: {
        what: number === 0 ? 'keep_out' : 'speed', origin: pose, resolution: f(32), usual: f(40),
        columns: u(48), rows: u(52), cells: new Uint8Array(data, 56),
      },
    }
  }
  return null
}

async function inflated(bytes: Uint8Array<ArrayBuffer>): Promise<Uint8Array> {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'))
  return new Uint8Array(await new Response(stream).arrayBuffer())
}

const UNKNOWN = 255

/** The map with this part drawn in; a new map for the first part. */
export async function painted(before: Grid | null, part: MapPart): Promise<Grid> {
  const cells = await inflated(part.cells)
  const same = before !== null && before.number === part.number && before.width === part.width
  const picture = same ? before.picture : document.createElement('canvas')
  const ctx = picture.getContext('2d')
  if (ctx === null) throw new Error('no canvas')
  if (!same) {
    picture.width = part.width
    picture.height = part.height
    ctx.fillStyle = '#c4c6c8'
    ctx.fillRect(0, 0, part.width, part.height)
  }
  const image = ctx.createImageData(part.columns, part.rows)
  const pixels = new Uint32Array(image.data.buffer)
  for (let row = 0; row < part.rows; row++) {
    const from = row * part.columns
    const to = (part.rows - 1 - row) * part.columns
    for (let i = 0; i < part.columns; i++) pixels[to + i] = shade(cells[from + i] ?? UNKNOWN)
  }
  ctx.putImageData(image, part.column, part.height - part.row - part.rows)
  return {
    number: part.number, origin: part.origin, resolution: part.resolution,
    width: part.width, height: part.height, picture, version: (before?.version ?? 0) + 1,
  }
}

/** Color of a cell, 0xAABBGGRR: free light, occupied dark, unknown in between. */
export function shade(cell: number): number {
  if (cell === UNKNOWN) return 0xffc8c6c4
  const grey = Math.round(240 - (Math.min(cell, 100) / 100) * 185)
  return (0xff000000 | (grey << 16) | (grey << 8) | grey) >>> 0
}

const STRIPES = 8
const [RED, DARK_RED, AMBER] = [0x3c2020c0, 0x902020c0, 0x4000a0e8] // 0xAABBGGRR

/** The picture of zones: keep-out hatched, speed zones tinted, each with its speed. */
export async function zoned(part: ZonePart): Promise<Zones> {
  const { columns, rows, what } = part
  const cells = await inflated(part.cells)
  const picture = document.createElement('canvas')
  picture.width = columns
  picture.height = rows
  const ctx = picture.getContext('2d')
  if (ctx === null) throw new Error('no canvas')
  const image = ctx.createImageData(columns, rows)
  const pixels = new Uint32Array(image.data.buffer)
  for (let row = 0; row < rows; row++) {
    for (let i = 0; i < columns; i++) {
      if (!cells[row * columns + i]) continue
      const striped = (row + i) % STRIPES < 2
      const at = (rows - 1 - row) * columns + i
      pixels[at] = what === 'speed' ? AMBER : striped ? DARK_RED : RED
    }
  }
  ctx.putImageData(image, 0, 0)
  const labels = what === 'speed' ? labelled(part, cells) : []
  const { origin, resolution } = part
  return { what, origin, resolution, columns, rows, cells, picture, labels }
}

/** One label for each connected zone of one speed, on its cell nearest to its center. */
function labelled(part: ZonePart, cells: Uint8Array): Zones['labels'] {
  const { columns, rows } = part
  const seen = new Uint8Array(cells.length)
  const found: Zones['labels'] = []
  for (let begin = 0; begin < cells.length && found.length < 200; begin++) {
    if (seen[begin] || !cells[begin]) continue
    const zone: number[] = [begin]
    seen[begin] = 1
    for (let k = 0; k < zone.length; k++) {
      const at = zone[k] ?? 0
      const i = at % columns
      const beside = [at - columns, at + columns, i > 0 ? at - 1 : -1, i + 1 < columns ? at + 1 : -1]
      for (const next of beside) {
        if (next < 0 || next >= rows * columns || seen[next]) continue
        if (cells[next] !== cells[begin]) continue
        seen[next] = 1
        zone.push(next)
      }
    }
    const of = (at: number): [number, number] => [at % columns, Math.floor(at / columns)]
    let [x, y] = [0, 0]
    for (const at of zone) {
      x += of(at)[0] / zone.length
      y += of(at)[1] / zone.length
    }
    const far = (at: number) => Math.hypot(of(at)[0] - x, of(at)[1] - y)
    const [i, j] = of(zone.reduce((best, at) => (far(at) < far(best) ? at : best), begin))
    const percent = cells[begin] ?? 0
    const speed = (percent / 100) * part.usual
    const text = Number.isFinite(speed) ? `${speed.toFixed(2)} m/s` : `${percent} %`
    found.push({ at: onMap(part, i + 0.5, j + 0.5), text })
  }
  return found
}

function onMap(zones: { origin: Pose; resolution: number }, i: number, j: number): [number, number] {
  const [x, y, psi] = zones.origin
  const [c, s, side] = [Math.cos(psi), Math.sin(psi), zones.resolution]
  return [x + side * (c * i - s * j), y + side * (s * i + c * j)]
}

/** Whether a point of the map is in a zone. */
export function within(zones: Zones, [px, py]: [number, number]): boolean {
  const [x, y, psi] = zones.origin
  const [c, s] = [Math.cos(psi), Math.sin(psi)]
  const i = Math.floor((c * (px - x) + s * (py - y)) / zones.resolution)
  const j = Math.floor((c * (py - y) - s * (px - x)) / zones.resolution)
  if (i < 0 || j < 0 || i >= zones.columns || j >= zones.rows) return false
  return (zones.cells[j * zones.columns + i] ?? 0) > 0
}

/** The nearest point outside the zone that a point is in, searched along rays; null: not in one. */
export function nearestExit(zones: Zones, from: [number, number]): [number, number] | null {
  if (!within(zones, from)) return null
  const farthest = zones.resolution * Math.hypot(zones.columns, zones.rows)
  for (let r = zones.resolution; r <= farthest; r += zones.resolution) {
    for (let k = 0; k < 72; k++) {
      const at: [number, number] = [
        from[0] + r * Math.cos((k * Math.PI) / 36), from[1] + r * Math.sin((k * Math.PI) / 36),
      ]
      if (!within(zones, at)) return at
    }
  }
  return null
}

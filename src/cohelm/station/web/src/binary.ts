// What comes as bytes; the layouts are those of src/cohelm/station/binary.py.

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

export type Binary = { map: MapPart } | { scan: Scan } | { frame: Frame } | null

const MAP = 1
const SCAN = 2
const FRAME = 3

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
  return null
}

async function inflated(bytes: Uint8Array<ArrayBuffer>): Promise<Uint8Array> {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'))
  return new Uint8Array(await new Response(stream).arrayBuffer())
}

const UNKNOWN = 255

/** A part drawn into the map it belongs to; a new map where it belongs to none yet. */
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

/** Colour of a cell, 0xAABBGGRR: free is light, occupied dark, unknown in between. */
export function shade(cell: number): number {
  if (cell === UNKNOWN) return 0xffc8c6c4
  const grey = Math.round(240 - (Math.min(cell, 100) / 100) * 185)
  return (0xff000000 | (grey << 16) | (grey << 8) | grey) >>> 0
}

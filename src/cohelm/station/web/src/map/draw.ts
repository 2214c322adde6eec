// Draws the map and all on it, from bottom to top.
import { nearestExit, type Grid, type Pose, type Zones } from '../binary'
import * as colour from '../colours'
import type { Discs, DockPlace, Hello, Status } from '../messages'
import { fromBody, toPixel, type Point, type Size, type View } from './view'

export interface Scene {
  grid: Grid | null
  zones: Zones[]
  scan: Float64Array
  discs: Discs['rows']
  docks: DockPlace[]
  reference: Point[]
  detour: Point[]
  trail: Point[]
  waypoints: Point[]
  /** Index of the waypoint that was refused. */
  worst: number | null
  chosen: number | null
  editing: boolean
  state: Status | null
  robot: Hello | null
  ghost: Pose | null
  lost: boolean
}

type Ctx = CanvasRenderingContext2D

export function draw(ctx: Ctx, v: View, size: Size, scene: Scene): void {
  ctx.fillStyle = '#c4c6c8'
  ctx.fillRect(0, 0, size.width, size.height)
  if (scene.grid !== null) drawGrid(ctx, v, size, scene.grid)
  for (const one of scene.zones) drawZones(ctx, v, size, one)
  drawScale(ctx, v, size)
  for (const dock of scene.docks) drawDock(ctx, v, size, dock, scene.robot)
  line(ctx, v, size, scene.trail, { stroke: colour.faint, width: 1.5 })
  line(ctx, v, size, scene.reference, { stroke: colour.path, width: 2, dash: [7, 5] })
  line(ctx, v, size, scene.detour, { stroke: colour.path, width: 2, dash: [2, 4] })
  drawGoal(ctx, v, size, scene)
  for (const one of scene.zones) drawSpeeds(ctx, v, size, one)
  drawDiscs(ctx, v, size, scene.discs)
  drawScan(ctx, v, size, scene.scan)
  if (scene.state !== null && scene.robot !== null) drawRobot(ctx, v, size, scene)
  if (scene.state !== null && !scene.lost) drawExit(ctx, v, size, scene)
  drawWaypoints(ctx, v, size, scene)
}

function drawGrid(ctx: Ctx, v: View, size: Size, grid: Grid): void {
  onCells(ctx, v, size, grid, (px, py, cell) => {
    if (grid.origin[2] !== 0) {
      ctx.drawImage(grid.picture, 0, -grid.height * cell, grid.width * cell, grid.height * cell)
    } else {
      drawVisiblePart(ctx, size, grid, px, py, cell)
    }
  })
}

/** Draw from the corner of cell (0, 0) on, along a raster's axes; cell: the side of one on the screen. */
function onCells(
  ctx: Ctx, v: View, size: Size, raster: Pick<Grid, 'origin' | 'resolution'>,
  how: (px: number, py: number, cell: number) => void,
): void {
  const [ox, oy, psi] = raster.origin
  const [px, py] = toPixel(v, size, [ox, oy])
  const cell = raster.resolution * v.scale
  ctx.save()
  ctx.imageSmoothingEnabled = cell < 1
  ctx.translate(px, py)
  ctx.rotate(-psi)
  how(px, py, cell)
  ctx.restore()
}

/** Only what is on the screen: software rendering pays for every pixel of the source. */
function drawVisiblePart(
  ctx: Ctx, size: Size, grid: Grid, px: number, py: number, cell: number,
): void {
  const top = py - grid.height * cell
  const c1 = Math.max(Math.floor(-px / cell), 0)
  const c2 = Math.min(Math.ceil((size.width - px) / cell), grid.width)
  const r1 = Math.max(Math.floor(-top / cell), 0)
  const r2 = Math.min(Math.ceil((size.height - top) / cell), grid.height)
  if (c2 <= c1 || r2 <= r1) return
  const [w, h] = [c2 - c1, r2 - r1]
  const y = -grid.height * cell + r1 * cell
  ctx.drawImage(grid.picture, c1, r1, w, h, c1 * cell, y, w * cell, h * cell)
}

function drawZones(ctx: Ctx, v: View, size: Size, zones: Zones): void {
  onCells(ctx, v, size, zones, (_px, _py, cell) => {
    ctx.drawImage(zones.picture, 0, -zones.rows * cell, zones.columns * cell, zones.rows * cell)
  })
}

/** The outline of the docked robot, its straight approach, and the dock's name in front of it. */
function drawDock(ctx: Ctx, v: View, size: Size, dock: DockPlace, robot: Hello | null): void {
  const { pose, approach } = dock
  if (pose === null || approach === null) return
  const begin = fromBody(pose, [-approach, 0])
  line(ctx, v, size, [begin, [pose[0], pose[1]]], FAINT)
  circle(ctx, toPixel(v, size, begin), 4)
  stroke(ctx, { ...FAINT, dash: [] })
  if (robot === null) return
  outline(ctx, v, size, pose, robot.outline)
  stroke(ctx, FAINT)
  const front = Math.max(...robot.outline.map((c) => c[0]))
  const [x, y] = toPixel(v, size, fromBody(pose, [front, 0]))
  const text = `dock ${dock.name}`
  ctx.font = LABEL
  const beyond = ctx.measureText(text).width / 2 + 0.2 * v.scale
  const at: Point = [x + beyond * Math.cos(pose[2]), y + 4 - (12 + 0.2 * v.scale) * Math.sin(pose[2])]
  label(ctx, text, at, colour.ink)
}

function drawSpeeds(ctx: Ctx, v: View, size: Size, zones: Zones): void {
  for (const { at, text } of zones.labels) {
    const [x, y] = toPixel(v, size, at)
    label(ctx, text, [x, y + 4], '#6b4700')
  }
}

/** An arrow from a robot inside a keep-out zone to the nearest exit. */
function drawExit(ctx: Ctx, v: View, size: Size, scene: Scene): void {
  const { state, zones } = scene
  const kept = zones.find((one) => one.what === 'keep_out')
  if (state === null || state.pose === null || kept === undefined) return
  const from: Point = [state.pose[0], state.pose[1]]
  const to = nearestExit(kept, from)
  if (to === null) return
  line(ctx, v, size, [from, to], { stroke: '#0a7a3c', width: 4 })
  const [x, y] = toPixel(v, size, to)
  const turn = Math.atan2(from[1] - to[1], to[0] - from[0])
  ctx.save()
  ctx.translate(x, y)
  ctx.rotate(turn)
  ctx.fillStyle = '#0a7a3c'
  ctx.beginPath()
  ctx.moveTo(12, 0)
  ctx.lineTo(-3, 9)
  ctx.lineTo(-3, -9)
  ctx.fill()
  ctx.restore()
  ctx.font = LABEL
  ctx.fillText('nearest exit', x + 14, y - 8)
}

function drawScale(ctx: Ctx, v: View, size: Size): void {
  const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20]
  const metres = steps.find((m) => m * v.scale > 60) ?? 50
  const y = size.height - 14
  const end = 12 + metres * v.scale
  trace(ctx, [[12, y - 5], [12, y], [end, y], [end, y - 5]])
  stroke(ctx, { stroke: colour.ink, width: 2 })
  ctx.fillStyle = colour.ink
  ctx.font = '12px system-ui, sans-serif'
  ctx.fillText(`${metres} m`, 16, y - 5)
}

interface Pen {
  stroke: string
  width: number
  dash?: number[]
}

const FAINT: Pen = { stroke: colour.faint, width: 1.5, dash: [2, 3] }
const LABEL = 'bold 12px system-ui, sans-serif'

/** Stroke the present path. */
function stroke(ctx: Ctx, pen: Pen): void {
  ctx.strokeStyle = pen.stroke
  ctx.lineWidth = pen.width
  ctx.setLineDash(pen.dash ?? [])
  ctx.stroke()
}

/** A path along pixels. */
function trace(ctx: Ctx, pixels: Point[]): void {
  ctx.beginPath()
  for (const [x, y] of pixels) ctx.lineTo(x, y) // the first one begins the path
}

function line(ctx: Ctx, v: View, size: Size, points: Point[], pen: Pen): void {
  if (points.length < 2) return
  trace(ctx, points.map((point) => toPixel(v, size, point)))
  stroke(ctx, pen)
}

/** A bold text with a white rim, centred at a pixel. */
function label(ctx: Ctx, text: string, at: Point, fill: string): void {
  ctx.font = LABEL
  ctx.textAlign = 'center'
  ctx.lineWidth = 3
  ctx.strokeStyle = '#fff'
  ctx.setLineDash([])
  ctx.strokeText(text, ...at)
  ctx.fillStyle = fill
  ctx.fillText(text, ...at)
  ctx.textAlign = 'start'
}

function drawDiscs(ctx: Ctx, v: View, size: Size, discs: Discs['rows']): void {
  for (const [x, y, vx, vy, radius, safe] of discs) {
    const at = toPixel(v, size, [x, y])
    circle(ctx, at, Math.max(radius * v.scale, 2))
    ctx.fillStyle = '#6b7278'
    ctx.fill()
    if (safe > radius) {
      circle(ctx, at, safe * v.scale)
      stroke(ctx, { stroke: '#6b7278', width: 1, dash: [3, 3] })
    }
    if (Math.hypot(vx, vy) > 0.02) {
      line(ctx, v, size, [[x, y], [x + vx, y + vy]], { stroke: colour.warning, width: 2 })
    }
  }
}

function circle(ctx: Ctx, [x, y]: Point, r: number): void {
  ctx.beginPath()
  ctx.arc(x, y, Math.max(r, 0), 0, 2 * Math.PI)
}

function drawScan(ctx: Ctx, v: View, size: Size, scan: Float64Array): void {
  ctx.fillStyle = colour.ink
  const [x0, y0] = [size.width / 2 - v.x * v.scale - 1, size.height / 2 + v.y * v.scale - 1]
  for (let i = 0; i + 1 < scan.length; i += 2) {
    ctx.fillRect(x0 + (scan[i] ?? 0) * v.scale, y0 - (scan[i + 1] ?? 0) * v.scale, 2, 2)
  }
}

/** Where the robot goes; while the route is edited its waypoints show that. */
function drawGoal(ctx: Ctx, v: View, size: Size, scene: Scene): void {
  const goal = scene.reference.at(-1)
  if (goal === undefined || scene.editing) return
  const [x, y] = toPixel(v, size, goal)
  for (const r of [3, 9]) {
    circle(ctx, [x, y], r)
    stroke(ctx, { stroke: colour.path, width: 3 })
  }
  label(ctx, 'goal', [x, y - 15], colour.path)
}

function drawWaypoints(ctx: Ctx, v: View, size: Size, scene: Scene): void {
  if (!scene.editing) return
  line(ctx, v, size, scene.waypoints, { stroke: colour.operator, width: 2, dash: [4, 4] })
  for (const [i, point] of scene.waypoints.entries()) {
    const [x, y] = toPixel(v, size, point)
    const bad = scene.worst === i
    circle(ctx, [x, y], 9)
    ctx.fillStyle = '#fff'
    ctx.fill()
    stroke(ctx, { stroke: bad ? colour.danger : colour.operator, width: scene.chosen === i ? 4 : 2 })
    ctx.fillStyle = bad ? colour.danger : colour.ink
    ctx.font = 'bold 11px system-ui, sans-serif'
    ctx.textAlign = 'center'
    ctx.fillText(bad ? '!' : String(i + 1), x, y + 4)
    ctx.textAlign = 'start'
  }
}

function outline(ctx: Ctx, v: View, size: Size, pose: Pose, corners: Point[]): void {
  trace(ctx, corners.map((corner) => toPixel(v, size, fromBody(pose, corner))))
  ctx.closePath()
}

/** The robot is found on a map of any size: it is drawn no shorter than this [pixel]. */
const ROBOT_PX = 20

function visible(corners: Point[], scale: number): Point[] {
  const long = 2 * Math.max(...corners.map(([x, y]) => Math.hypot(x, y))) * scale
  if (!(long > 0) || long >= ROBOT_PX) return corners
  return corners.map(([x, y]): Point => [x * ROBOT_PX / long, y * ROBOT_PX / long])
}

function drawRobot(ctx: Ctx, v: View, size: Size, scene: Scene): void {
  const { state, robot, ghost } = scene
  if (state === null || state.pose === null || robot === null) return
  line(ctx, v, size, [[state.pose[0], state.pose[1]], ...state.ahead], {
    stroke: colour.operator, width: 3,
  })
  if (state.reference !== null) {
    circle(ctx, toPixel(v, size, [state.reference[0], state.reference[1]]), 5)
    stroke(ctx, { stroke: colour.path, width: 2 })
  }
  if (ghost !== null) {
    outline(ctx, v, size, ghost, robot.outline)
    stroke(ctx, { stroke: colour.operator, width: 1.5, dash: [4, 3] })
  }
  const corners = visible(robot.outline, v.scale)
  outline(ctx, v, size, state.pose, corners)
  ctx.fillStyle = scene.lost ? 'rgba(180, 85, 0, 0.5)' : 'rgba(255, 255, 255, 0.85)'
  ctx.fill()
  stroke(ctx, { stroke: scene.lost ? colour.warning : colour.ink, width: 2.5 })
  drawNose(ctx, v, size, state.pose, corners)
  const { limiting } = state
  if (limiting !== null) drawLimiting(ctx, v, size, limiting)
}

function drawNose(ctx: Ctx, v: View, size: Size, pose: Pose, corners: Point[]): void {
  const front = Math.max(...corners.map((c) => c[0]))
  const half = Math.max(...corners.map((c) => c[1])) * 0.6
  const tip: Point[] = [[front * 0.9, 0], [front * 0.25, half], [front * 0.25, -half]]
  outline(ctx, v, size, pose, tip)
  ctx.fillStyle = colour.ink
  ctx.fill()
}

function drawLimiting(ctx: Ctx, v: View, size: Size, at: Point): void {
  const [x, y] = toPixel(v, size, at)
  for (const side of [7, -7]) {
    trace(ctx, [[x - side, y - 7], [x + side, y + 7]])
    stroke(ctx, { stroke: colour.warning, width: 3 })
  }
}

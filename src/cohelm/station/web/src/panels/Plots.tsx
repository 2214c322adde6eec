// Plots of the last half minute.
import { useEffect, useRef } from 'preact/hooks'
import uPlot from 'uplot'
import 'uplot/dist/uPlot.min.css'
import * as colour from '../colours'
import type { Status } from '../messages'
import * as s from '../state'

const SPAN_S = 30
const EVERY_MS = 250
/** What is older is not now. */
const SILENT_S = 0.5
const KEPT = 900
const HEIGHT = 84

interface Curve {
  name: string
  of: (state: Status) => number | null
  stroke: string
  dash?: number[]
}

interface Chart {
  title: string
  curves: Curve[]
  /** Range that is always shown. */
  shown: [number, number]
}

const CHARTS: Chart[] = [
  {
    title: 'v [m/s]',
    curves: [
      { name: 'nominal', of: (x) => x.nominal?.[0] ?? null, stroke: colour.faint, dash: [5, 4] },
      { name: 'applied', of: (x) => x.applied?.[0] ?? null, stroke: colour.ink },
    ],
    shown: [0, 0.5],
  },
  {
    title: 'ω [rad/s]',
    curves: [
      { name: 'nominal', of: (x) => x.nominal?.[1] ?? null, stroke: colour.faint, dash: [5, 4] },
      { name: 'applied', of: (x) => x.applied?.[1] ?? null, stroke: colour.ink },
    ],
    shown: [-0.5, 0.5],
  },
  { title: 'error E_P', curves: [{ name: 'error', of: (x) => x.e_p, stroke: colour.ink }], shown: [0, 0.5] },
  {
    title: '',
    curves: [
      { name: 'clearance [m]', of: (x) => x.clearance_seen, stroke: colour.ink },
      { name: 'h [m²]', of: (x) => x.h, stroke: colour.faint, dash: [5, 4] },
    ],
    shown: [0, 1],
  },
  { title: 'authority e^(−V_h)', curves: [{ name: 'share', of: (x) => x.authority, stroke: colour.ink }], shown: [0, 1] },
]

const kept: Status[] = []
s.state.subscribe((state) => {
  if (state === null) return
  // a replay that was moved back begins anew
  if (kept.length > 0 && state.stamp < (kept.at(-1)?.stamp ?? 0)) kept.length = 0
  kept.push(state)
  if (kept.length > KEPT) kept.splice(0, kept.length - KEPT)
})

function data(chart: Chart): uPlot.AlignedData {
  const silent = s.isReplay.value ? 0 : s.stateAge(performance.now()) / 1000
  const now = (kept.at(-1)?.stamp ?? 0) + (silent > SILENT_S && silent < Infinity ? silent : 0)
  const rows = kept.filter((state) => state.stamp > now - SPAN_S)
  return [rows.map((r) => r.stamp - now), ...chart.curves.map((c) => rows.map(c.of))]
}

const MOST = 3

/** The range to draw; far outliers are cut. */
function within([least, most]: [number, number], low: number | null, high: number | null): [number, number] {
  const bottom = Math.min(least, low ?? least)
  const top = Math.max(most, high ?? most)
  const edge = MOST * Math.max(Math.abs(least), most)
  return [Math.max(bottom * 1.05, -edge), Math.min(top * 1.05, edge)]
}

function made(chart: Chart, into: HTMLElement): uPlot {
  const options: uPlot.Options = {
    width: into.clientWidth || 260,
    height: HEIGHT,
    legend: { show: false },
    cursor: { show: false },
    padding: [4, 14, 0, 0],
    scales: {
      x: { time: false, range: [-SPAN_S, 0] },
      y: { range: (_, low, high) => within(chart.shown, low, high) },
    },
    axes: [
      { show: true, size: 16, font: '10px system-ui', stroke: colour.faint, grid: { show: false }, ticks: { show: false },
        values: (_, at) => at.map((v) => (v === 0 ? 'now' : `${v} s`)) },
      // by uPlot's own space of 30 many ranges had the tick of 0 alone, and no scale
      { show: true, size: 34, space: 16, font: '10px system-ui', stroke: colour.ink, grid: { stroke: '#cfd2d4', width: 1 }, ticks: { show: false } },
    ],
    series: [{}, ...chart.curves.map((c) => ({
      label: c.name, stroke: c.stroke, width: 1.5, points: { show: false }, ...(c.dash ? { dash: c.dash } : {}),
    }))],
  }
  return new uPlot(options, data(chart), into)
}

function One({ chart }: { chart: Chart }) {
  const ref = useRef<HTMLDivElement>(null)
  useEffect(() => {
    const into = ref.current
    if (into === null) return
    const plot = made(chart, into)
    const timer = setInterval(() => {
      if (into.clientWidth === 0 || document.visibilityState === 'hidden') return
      if (plot.width !== into.clientWidth) plot.setSize({ width: into.clientWidth, height: HEIGHT })
      plot.setData(data(chart))
    }, EVERY_MS)
    return () => {
      clearInterval(timer)
      plot.destroy()
    }
  }, [])
  return (
    <figure>
      <figcaption>
        {chart.title}
        {chart.curves.length > 1 && chart.curves.map((c) => (
          <span key={c.name} class={c.dash ? 'dashed' : ''}> {c.dash ? '╌' : '─'} {c.name}</span>
        ))}
      </figcaption>
      <div ref={ref} role="img" aria-label={`${chart.title || 'clearance and h'} over the last ${SPAN_S} seconds`} />
    </figure>
  )
}

export function Plots() {
  return (
    <section class="plots" aria-label="Plots">
      {CHARTS.map((chart) => <One key={chart.title} chart={chart} />)}
    </section>
  )
}

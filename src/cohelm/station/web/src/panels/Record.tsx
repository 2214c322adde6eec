// Recording, on the robot's side.
import { signal } from '@preact/signals'
import { authorizedFetch } from '../session'
import { ask } from '../socket'
import * as s from '../state'
import { useEscape } from './escape'
import { bytes } from './format'

const open = signal(false)
type Status = { text: string; hash: string }
/** Status of each download, by the record's name. */
const statuses = signal<{ [name: string]: Status }>({})

function path(name: string): string {
  return `./records/${encodeURIComponent(name)}`
}

function setStatus(name: string, text: string, hash = ''): void {
  statuses.value = { ...statuses.value, [name]: { text, hash } }
}

/** A plain link can not send the session, so it gets a ticket for this record. */
async function download(name: string): Promise<void> {
  if (s.link.value?.connected === false) return setStatus(name, 'no link to the robot: click again when there is one')
  setStatus(name, 'the robot computes its SHA-256 …')
  let answer: Response
  try {
    answer = await authorizedFetch(path(name), { method: 'POST' })
  } catch {
    return setStatus(name, 'the station does not answer')
  }
  if (!answer.ok) return setStatus(name, await answer.text())
  const { ticket, sha256 } = (await answer.json()) as { ticket: string; sha256: string }
  setStatus(name, '', sha256)
  const link = document.createElement('a')
  link.href = `${path(name)}?ticket=${ticket}`
  link.download = name
  link.click()
}

export function Record() {
  if (s.isReplay.value) return null
  const on = s.state.value?.recording === true
  return (
    <div class="record">
      <button
        type="button" aria-pressed={on} class={on ? 'on' : ''} disabled={!s.linked.value || s.state.value === null}
        onClick={() => ask(on ? 'record_stop' : 'record')}
      >
        {on ? '■ Stop recording' : '● Record'}
      </button>
      <button type="button" aria-expanded={open.value} onClick={() => (open.value = !open.value)}>
        Records ({s.records.value.length})
      </button>
      {open.value && <Files />}
    </div>
  )
}

function Files() {
  useEscape(() => (open.value = false))
  const files = s.records.value
  return (
    <div class="files" role="dialog" aria-label="Records">
      <ul aria-label="Records on the robot">
        {files.length === 0 && <li>none yet</li>}
        {files.map((file) => (
          <li key={file.name}>
            <a
              href={path(file.name)}
              onClick={(event) => {
                event.preventDefault()
                void download(file.name)
              }}
            >
              {file.name}
            </a>{' '}
            {bytes(file.size)}
            <DownloadStatus of={statuses.value[file.name]} />
          </li>
        ))}
      </ul>
    </div>
  )
}

function DownloadStatus({ of }: { of: Status | undefined }) {
  if (of === undefined) return null
  return (
    <small role="status">
      {of.text}
      {of.hash !== '' && <>SHA-256 <code>{of.hash}</code></>}
    </small>
  )
}

"""The report's page; braces are for `str.format`."""

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ font: 15px/1.45 system-ui, sans-serif; color: #222; max-width: 72rem; margin: 2rem auto;
  padding: 0 1rem; }}
table {{ border-collapse: collapse; margin: .8rem 0 1.6rem; font-variant-numeric: tabular-nums; }}
th, td {{ text-align: left; padding: .25rem .9rem .25rem 0; border-bottom: 1px solid #ddd; }}
th {{ border-bottom: 2px solid #888; }}
p, ul {{ max-width: 46rem; }}
.figures {{ display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(26rem, 1fr)); }}
figure {{ margin: 0; }} img {{ width: 100%; }} figcaption {{ font-size: 13.5px; color: #444; }}
summary {{ cursor: pointer; color: #555; }}
@media (prefers-color-scheme: dark) {{ body {{ background: #161616; color: #ddd; }}
  figcaption, summary {{ color: #bbb; }}
  img {{ filter: invert(.9) hue-rotate(180deg); }} th, td {{ border-color: #444; }} }}
</style></head><body>
<h1>{title}</h1>
<h2>Law by law</h2>
{laws}
<p>A contact is an overlap of the robot's real outline with anything, looked for between control
steps too. It is a <em>moving</em> one if it began while the robot moved of its own; else it is a
<em>standing</em> one: the robot stood and was walked into. If the robot then moved, and deeper into
what it overlapped, it is a <em>departing</em> one as well. Counts are of episodes, in
brackets with exact two-sided 95 % bounds (Clopper and Pearson) of the probability behind them.
Other values are the median over the episodes, in brackets the smallest and the largest. All laws
drove the same episodes.</p>
<h2>{first}, by kind of episode</h2>
{kinds}
<h2>Worst episodes</h2>
<p>From above, and the outline's clearance and the speed over time. A <em>moving</em> contact is
one in which the robot drove; in a <em>standing</em> one it stood and was walked into. Each
episode can be driven again alone and recorded: <code>cohelm campaign FOLDER --replay
LAW/NUMBER</code>.</p>
<div class="figures">
{figures}
</div>
<h2>What was driven</h2>
{about}
{notes}
</body></html>
"""

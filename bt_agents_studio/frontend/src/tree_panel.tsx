// SPDX-License-Identifier: Apache-2.0
// Panel of a behaviour tree: its search, and its outline or map.

import { lazy, memo, Suspense, useCallback, useEffect, useMemo, useRef, useState } from "react";
import { Outline } from "./outline";
import type { TreeNodeRecord } from "./protocol";
import shared from "./shared.module.css";
import { readEntry } from "./store";
import { texts } from "./texts";
import type { DrawingProps } from "./tree_drawing";
import { byPathOf, find, nest, withoutModifier } from "./tree_nesting";

/** Load the map, which few open. */
export const loadMap = () => import("./tree").then(({ Tree }) => ({ default: Tree }));

const DRAWINGS = { outline: Outline, map: lazy(loadMap) };
type Drawing = keyof typeof DRAWINGS;
/** Key under which the browser keeps the last chosen drawing. */
const KEPT = "drawing";

const NOTHING: ReadonlySet<string> = new Set();

type TreePanelProps = Pick<DrawingProps, "record" | "tip" | "chosen" | "choose" | "stops" | "toggleStop" | "showDetails">;

export const TreePanel = memo(function TreePanel(props: TreePanelProps) {
  const { record, tip, chosen } = props;
  const [drawing, setDrawing] = useState<Drawing>(localStorage.getItem(KEPT) === "map" ? "map" : "outline");
  const [folded, setFolded] = useState(NOTHING);
  const [search, setSearch] = useState("");
  // The address may name a node.
  const [goal, setGoal] = useState({ path: chosen });
  const chosenHere = useRef(chosen);
  const searching = useRef<HTMLInputElement>(null);
  const roots = useMemo(() => nest(record), [record]);
  const byPath = useMemo(() => byPathOf(roots), [roots]);
  const results = useMemo(() => find(record, search), [record, search]);
  const found = useMemo(() => new Set(results), [results]);

  /** Bring a node into view, unfolding it if necessary. */
  const goTo = (path: string): void => {
    setFolded((before) => {
      const after = new Set(before);
      for (let one = byPath.get(path)?.parent; one; one = one.parent) after.delete(one.node.path);
      return after.size < before.size ? after : before;
    });
    setGoal({ path });
  };
  const choose = useCallback(
    (path: string): void => {
      chosenHere.current = path;
      props.choose(path);
    },
    [props.choose],
  );
  // The palette and the back button choose nodes, too.
  useEffect(() => {
    if (chosen === chosenHere.current) return;
    chosenHere.current = chosen;
    if (chosen !== "") goTo(withoutModifier(chosen));
  }, [chosen]);
  const fold = useCallback((path: string): void => {
    setFolded((before) => {
      const after = new Set(before);
      if (!after.delete(path)) after.add(path);
      return after;
    });
  }, []);
  const goToResult = (step: number): void => {
    const index = results.indexOf(chosen);
    const from = index < 0 && step < 0 ? 0 : index;
    const next = results[(from + step + results.length) % results.length];
    if (next === undefined) return;
    choose(next);
    goTo(next);
  };
  const draw = (name: Drawing): void => {
    localStorage.setItem(KEPT, name);
    setGoal({ path: "" });
    setDrawing(name);
  };

  const tools = (
    <>
      <input
        ref={searching}
        type="search"
        aria-label={texts.live.search}
        placeholder={texts.live.search}
        value={search}
        onChange={(event) => {
          setSearch(event.target.value);
          // Another run would replace the tree, and lose the text.
          choose(chosen);
        }}
        onKeyDown={(event) => {
          if (event.key === "Enter") goToResult(event.shiftKey ? -1 : 1);
        }}
      />
      {search.trim() !== "" && (
        <output>
          {found.has(chosen) ? `${results.indexOf(chosen) + 1} ${texts.live.of} ` : ""}
          {results.length} {texts.live.found}
        </output>
      )}
      <span role="group" aria-label={texts.live.drawing}>
        {(Object.keys(DRAWINGS) as Drawing[]).map((name) => (
          <button key={name} type="button" aria-pressed={name === drawing} onClick={() => draw(name)}>
            {texts.live[name]}
          </button>
        ))}
      </span>
    </>
  );
  const Drawn = DRAWINGS[drawing];
  return (
    <section className={shared.panel} aria-label={texts.live.tree}>
      <Suspense>
        <Drawn
          {...props}
          choose={choose}
          tip={withoutModifier(tip)}
          roots={roots}
          byPath={byPath}
          folded={folded}
          fold={fold}
          goal={goal}
          goTo={goTo}
          found={found}
          focusSearch={() => searching.current?.focus()}
          tools={tools}
        />
      </Suspense>
    </section>
  );
});

export function lineOf(agent: string, path: string): TreeNodeRecord | undefined {
  return readEntry("trees", agent)?.nodes.find((one) => one.path === path);
}

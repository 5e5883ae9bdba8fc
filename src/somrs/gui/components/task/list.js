// The list of tasks as a table. NiceGUI rebuilds a table slot at each change, which loses the focus; this element keeps it.

export default {
  template: `
    <q-table flat hide-selected-banner row-key="task" :rows="rows" :columns="columns" v-model:pagination="pages"
      :rows-per-page-options="[10, 25, 50, 0]" rows-per-page-label="Tasks per page">
      <template v-slot:body="props">
        <q-tr :props="props" :key="props.row.task" :class="'somrs-task-row somrs-tone-' + props.row.tone">
          <q-td class="somrs-task-far">
            <span :class="'somrs-badge somrs-' + props.row.tone">
              <i class="q-icon material-icons" aria-hidden="true">{{ props.row.icon }}</i>{{ props.row.far }}</span>
            <div class="somrs-task-bar" role="progressbar" aria-label="Done" aria-valuemin="0" aria-valuemax="100"
              :aria-valuenow="props.row.percent"><div :style="{width: props.row.percent + '%'}"></div></div>
            <span class="somrs-soft">{{ props.row.steps }}</span>
          </q-td>
          <q-td class="somrs-task-goal">
            <a class="somrs-formula" :href="props.row.href">{{ props.row.effect }}</a>
            <div v-if="props.row.asks" class="somrs-badge somrs-busy">
              <i class="q-icon material-icons" aria-hidden="true">help</i>{{ props.row.asks }} is asked</div>
            <div v-if="props.row.setbacks" class="somrs-task-note somrs-bad-text">
              <i class="q-icon material-icons" aria-hidden="true">error</i>{{ props.row.setbacks }}</div>
            <div v-if="props.row.note" class="somrs-soft somrs-task-note">{{ props.row.note }}</div>
            <div v-for="wait in props.row.waits" :key="wait.href" class="somrs-soft somrs-waits">Waits for
              <a class="somrs-formula" :href="wait.href">{{ wait.goal }}</a>, which {{ wait.reserved }}.</div>
          </q-td>
          <q-td class="somrs-task-stated">{{ props.row.stated }}<div class="somrs-soft">{{ props.row.who }}</div>
            <div v-if="props.row.manager" class="somrs-soft">{{ props.row.manager }}</div></q-td>
          <q-td class="somrs-task-took">{{ props.row.took }}</q-td>
          <q-td class="somrs-task-due">{{ props.row.due }}</q-td>
          <q-td class="somrs-task-priority">{{ props.row.priority }}</q-td>
          <q-td class="somrs-task-retry">
            <button v-if="props.row.retry" type="button" class="somrs-task-again" :aria-label="props.row.retry" title="Retry"
              @click="$emit('retry', {task: props.row.task, once: visit + props.row.task})">
              <i class="q-icon material-icons" aria-hidden="true">replay</i></button>
          </q-td>
        </q-tr>
      </template>
      <template v-slot:no-data><span class="somrs-soft">{{ nothing }}</span></template>
    </q-table>
  `,
  emits: ["retry"],
  props: { rows: { type: Array, default: () => [] }, columns: { type: Array, default: () => [] }, nothing: { type: String, default: "" } },
  data() {
    // The key of the buttons: a second click on one, such as a double click, submits no second task.
    return { pages: { rowsPerPage: 25 }, visit: `${Date.now()}-${Math.random()}-` };
  },
};
